//! The number type that material laws are written over: `f64` in the reference path, 16 `f32` lanes in the
//! fast path, one text for both.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A real number or a vector of independent real lanes.
///
/// Every operation is correctly rounded or, for [`ln`](Self::ln) and [`exp`](Self::exp), built from such
/// operations in a fixed order, so that a law gives the same bits on every instruction set.
pub trait Real:
    Copy
    + Send
    + Sync
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// One truth value per lane.
    type Mask: Copy;

    /// The same value in every lane.
    fn splat(value: f64) -> Self;
    /// `self * a + b`, rounded once.
    fn mul_add(self, a: Self, b: Self) -> Self;
    /// Square root, correctly rounded.
    fn sqrt(self) -> Self;
    /// Natural logarithm.
    fn ln(self) -> Self;
    /// Exponential.
    fn exp(self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// Lane-wise smaller value.
    fn min(self, other: Self) -> Self;
    /// Lane-wise larger value.
    fn max(self, other: Self) -> Self;
    /// Lane-wise `self < other`; false where either is NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// Lane-wise `mask ? a : b`.
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self;
    /// Whether any lane is true.
    fn any(mask: Self::Mask) -> bool;
}
