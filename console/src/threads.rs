//! Numbers of threads on the command line.

/// Most threads that a solver may have: more than any machine has processors, and few enough to start within a second.
const MOST: usize = 1024;

/// Reads a number of threads, 1 to 1024, or 0 for one per core.
///
/// # Errors
/// A sentence with what was given and what is expected.
pub fn threads(text: &str) -> Result<usize, String> {
    let number = text.trim().parse().ok();
    number
        .filter(|threads| (0..=MOST).contains(threads))
        .ok_or_else(|| format!("expected 1 to {MOST} threads, or 0 for one per core, not {text:?}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn absurd_numbers_of_threads_are_refused_in_a_sentence() {
        for (text, number) in [("0", 0), ("2", 2), ("1024", 1024)] {
            assert_eq!(threads(text), Ok(number));
        }
        for bad in [
            "1025",
            "5000",
            "18446744073709551615",
            "-1",
            "1.5",
            "",
            "all",
        ] {
            let error = threads(bad).expect_err(bad);
            assert!(
                error.contains("1 to 1024") && error.contains(bad),
                "{error}"
            );
        }
    }
}
