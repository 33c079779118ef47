//! Times on the command line.

use std::time::Duration;

/// Longest time that can be asked for [s]: 31 years, which every clock can add to now.
const LONGEST: f64 = 1e9;

/// Shortest simulated time that is more than none [s].
const SHORTEST: f64 = 1e-9;

/// Reads a time to wait, 0 to 1e9 [s].
///
/// # Errors
/// A sentence with what was given and what is expected.
pub fn duration(text: &str) -> Result<Duration, String> {
    number(text).map(Duration::from_secs_f64)
}

/// Reads a simulated time, 0 to 1e9 [s].
///
/// # Errors
/// A sentence with what was given and what is expected.
pub fn number(text: &str) -> Result<f64, String> {
    at_least(0.0, text)
}

/// Reads a simulated time that is more than none, 1e-9 to 1e9 [s].
///
/// # Errors
/// A sentence with what was given and what is expected.
pub fn positive(text: &str) -> Result<f64, String> {
    at_least(SHORTEST, text)
}

fn at_least(least: f64, text: &str) -> Result<f64, String> {
    match text.trim().parse() {
        Ok(seconds) if (least..=LONGEST).contains(&seconds) => Ok(seconds),
        _ => Err(format!(
            "expected a number of seconds, {least:?} to {LONGEST:e}, not {text:?}"
        )),
    }
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::*;

    #[test]
    fn times_are_read_or_refused_in_a_sentence() {
        assert_eq!(duration("2.5"), Ok(Duration::from_millis(2500)));
        assert_eq!(number("0"), Ok(0.0));
        let longest = duration("1e9").expect("31 years");
        assert!(Instant::now().checked_add(longest).is_some());
        assert_eq!(positive("1e-9"), Ok(1e-9));
        assert!(positive("0").is_err_and(|error| error.contains("1e-9 to 1e9")));
        for bad in ["1e19", "1.0001e9", "inf", "NaN", "-1", "-inf", "soon", ""] {
            let error = duration(bad).expect_err(bad);
            assert!(
                error.contains("0.0 to 1e9") && error.contains(bad),
                "{error}"
            );
        }
    }
}
