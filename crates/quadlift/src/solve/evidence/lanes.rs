//! Four numbers at once: one for each edge of a box. Plain arrays, which compilers turn into vector instructions.

use std::ops::{Add, Div, Mul, Sub};

/// Four numbers.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Lanes(pub [f64; 4]);

macro_rules! lanewise {
    ($($operator:ident $name:ident $sign:tt;)+) => {$(
        impl $operator for Lanes {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                let (a, b) = (self.0, other.0);
                Self([a[0] $sign b[0], a[1] $sign b[1], a[2] $sign b[2], a[3] $sign b[3]])
            }
        }
    )+};
}

lanewise! {
    Add add +;
    Sub sub -;
    Mul mul *;
    Div div /;
}

impl Mul<f64> for Lanes {
    type Output = Self;

    #[inline(always)]
    fn mul(self, factor: f64) -> Self {
        self * Self::splat(factor)
    }
}

impl Lanes {
    pub(super) const ZERO: Self = Self([0.0; 4]);

    #[inline(always)]
    pub(super) fn splat(x: f64) -> Self {
        Self([x; 4])
    }

    #[inline(always)]
    pub(super) fn map(self, f: impl Fn(f64) -> f64) -> Self {
        let x = self.0;
        Self([f(x[0]), f(x[1]), f(x[2]), f(x[3])])
    }

    #[inline(always)]
    pub(super) fn sqrt(self) -> Self {
        self.map(f64::sqrt)
    }

    #[inline(always)]
    pub(super) fn inverse(self) -> Self {
        Self::splat(1.0) / self
    }

    /// The number of the opposite edge.
    #[inline(always)]
    pub(super) fn opposite(self) -> Self {
        let x = self.0;
        Self([x[2], x[3], x[0], x[1]])
    }

    #[inline(always)]
    pub(super) fn sum(self) -> f64 {
        let x = self.0;
        (x[0] + x[1]) + (x[2] + x[3])
    }

    #[inline(always)]
    pub(super) fn product(self) -> f64 {
        let x = self.0;
        (x[0] * x[1]) * (x[2] * x[3])
    }

    /// `|v|` and its slope, where below `width` a parabola replaces the kink.
    #[inline(always)]
    pub(super) fn rounded_abs(self, width: Self) -> (Self, Self) {
        let slope = (self / width).map(|x| x.clamp(-1.0, 1.0));
        let mut value = self.map(f64::abs);
        for k in 0..4 {
            if slope.0[k].abs() < 1.0 {
                value.0[k] = value.0[k].max(0.5 * (self.0[k] * slope.0[k] + width.0[k]));
            }
        }
        (value, slope)
    }
}

/// The dot products of three components, as lanes, with a vector.
#[inline(always)]
pub(super) fn dot(components: &[Lanes; 3], vector: &[f64; 3]) -> Lanes {
    components[0] * vector[0] + components[1] * vector[1] + components[2] * vector[2]
}
