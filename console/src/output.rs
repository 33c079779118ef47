//! The one place through which commands print.
//!
//! The standard macros panic where nobody reads any more, as behind `| head`. That ends neither a command nor its work
//! here, and its exit status says how the work went.

use std::{
    fmt,
    io::{self, ErrorKind, Write},
    net::SocketAddr,
};

use anyhow::Context;

/// Prints a line on standard output, like `println!`.
///
/// # Errors
/// When the output takes no more, such as a file on a full disk.
#[macro_export]
macro_rules! say {
    ($($text:tt)*) => {
        $crate::output::line(&mut std::io::stdout(), format_args!($($text)*))
    };
}

/// Prints a line on standard error, like `eprintln!`, if anybody listens.
#[macro_export]
macro_rules! note {
    ($($text:tt)*) => {
        $crate::output::aside(format_args!($($text)*))
    };
}

/// Writes a line; a reader that has seen enough is no failure.
///
/// # Errors
/// When the output takes no more.
pub fn line(out: &mut impl Write, text: fmt::Arguments) -> anyhow::Result<()> {
    // At once and whole: a result must not wait in a buffer for an exit that drops it.
    match writeln!(out, "{text}").and_then(|()| out.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        outcome => outcome.context("cannot write to standard output"),
    }
}

/// Writes a line to standard error; there is no other place left to say that this failed.
pub fn aside(text: fmt::Arguments) {
    let _ = writeln!(io::stderr(), "{text}");
}

/// Prints the `link` of a page, and what else whoever has it `may` do where other machines reach it.
///
/// # Errors
/// When the output takes no more.
pub fn announce(link: &str, is_local: bool, address: SocketAddr, may: &str) -> anyhow::Result<()> {
    if !is_local {
        note!(
            "other machines reach {address}: whoever has the link may watch and {may}, and the link is not encrypted"
        );
    }
    say!("{link}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An output that fails in one way.
    struct Failing(ErrorKind);

    impl Write for Failing {
        fn write(&mut self, _: &[u8]) -> io::Result<usize> {
            Err(self.0.into())
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_closed_pipe_is_no_failure_and_a_full_disk_is() {
        let mut written = Vec::new();
        line(&mut written, format_args!("{} of {}", 1, 2)).expect("memory takes all");
        assert_eq!(written, b"1 of 2\n");
        line(&mut Failing(ErrorKind::BrokenPipe), format_args!("a")).expect("nobody reads");
        let error = line(&mut Failing(ErrorKind::StorageFull), format_args!("a"));
        let words = format!("{:#}", error.expect_err("nothing is written"));
        assert!(
            words.starts_with("cannot write to standard output: "),
            "{words}"
        );
    }
}
