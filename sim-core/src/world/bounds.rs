//! Bounds of the numbers in commands.

use crate::command::CommandError;

/// Largest coordinate of a commanded point, and radius [m].
pub(super) const MAX_LENGTH: f64 = 1e6;

/// Refuses a number that is none.
pub(super) fn finite(field: &'static str, values: &[f64]) -> Result<(), CommandError> {
    match values.iter().find(|value| !value.is_finite()) {
        Some(&value) => Err(CommandError::NotFinite { field, value }),
        None => Ok(()),
    }
}

/// Refuses a number outside of bounds.
pub(super) fn within(
    field: &'static str,
    value: f64,
    min: f64,
    max: f64,
) -> Result<(), CommandError> {
    finite(field, &[value])?;
    if (min..=max).contains(&value) {
        return Ok(());
    }
    Err(CommandError::OutOfRange {
        field,
        value,
        min,
        max,
    })
}
