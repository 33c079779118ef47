//! The one place through which commands print.
//!
//! The standard macros panic where nobody reads any more, as behind `| head`. That ends neither a command nor its work
//! here, and its exit status says how the work went.
//!
//! Names and sentences come from files and from other processes. What would make a terminal do something is printed as what it
//! is, `\u001b`: an escape sequence could hide lines, rename the window or answer in the user's stead.

use std::{
    borrow::Cow,
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
    match writeln!(out, "{}", plain(&text.to_string())).and_then(|()| out.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        outcome => outcome.context("cannot write to standard output"),
    }
}

/// Writes a line to standard error; there is no other place left to say that this failed.
pub fn aside(text: fmt::Arguments) {
    let _ = writeln!(io::stderr(), "{}", plain(&text.to_string()));
}

/// The text with all that a terminal obeys written out: control characters but for the end of a line and the tabulator, and what
/// turns the direction of writing round. In a string of JSON it means the same as before.
pub fn plain(text: &str) -> Cow<'_, str> {
    if !text.chars().any(is_obeyed) {
        return text.into();
    }
    let mut plain = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        match is_obeyed(c) {
            true => plain.push_str(&format!("\\u{:04x}", u32::from(c))),
            false => plain.push(c),
        }
    }
    plain.into()
}

fn is_obeyed(c: char) -> bool {
    let turns =
        matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    turns || (c.is_control() && c != '\n' && c != '\t')
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
    fn what_a_terminal_would_obey_is_written_out() {
        let mut written = Vec::new();
        let name = "\u{1b}]0;owned\u{7}ball\r\u{9b}2J\u{202e}";
        line(&mut written, format_args!("{name}\tis\nhere")).expect("memory takes all");
        let text = String::from_utf8(written).expect("text");
        assert_eq!(
            text,
            "\\u001b]0;owned\\u0007ball\\u000d\\u009b2J\\u202e\tis\nhere\n"
        );
        assert!(matches!(plain("größer als 1 µm"), Cow::Borrowed(_)));
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
