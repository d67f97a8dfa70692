//! Numbers that are worked on at once: the widest registers that a machine is likely to have hold [`LANES`] of them.
//!
//! Plain loops of fixed length, which compilers turn into one instruction each where the function around them is compiled for
//! such registers. No step is fused with another, so that all machines reckon the same to the last bit.

use std::ops::{Add, AddAssign, Div, Mul, Sub};

/// How many.
pub const LANES: usize = 8;

/// Some numbers in single precision.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(align(32))]
pub struct Lanes(pub [f32; LANES]);

impl Lanes {
    /// All 0.
    pub const ZERO: Self = Self([0.0; LANES]);

    /// The same in all lanes.
    #[inline(always)]
    pub fn all(value: f32) -> Self {
        Self([value; LANES])
    }

    /// What a function makes of each.
    #[inline(always)]
    pub fn map(self, of: impl Fn(f32) -> f32) -> Self {
        let mut to = Self::ZERO;
        for lane in 0..LANES {
            to.0[lane] = of(self.0[lane]);
        }
        to
    }

    /// What a function makes of each and its other.
    #[inline(always)]
    pub fn with(self, other: Self, of: impl Fn(f32, f32) -> f32) -> Self {
        let mut to = Self::ZERO;
        for lane in 0..LANES {
            to.0[lane] = of(self.0[lane], other.0[lane]);
        }
        to
    }

    /// No less than this.
    #[inline(always)]
    pub fn at_least(self, least: f32) -> Self {
        self.map(|value| if value > least { value } else { least })
    }

    /// No more than this.
    #[inline(always)]
    pub fn at_most(self, most: f32) -> Self {
        self.map(|value| if value < most { value } else { most })
    }

    /// Their square roots.
    #[inline(always)]
    pub fn sqrt(self) -> Self {
        self.map(f32::sqrt)
    }

    /// Their sum.
    #[inline(always)]
    pub fn sum(self) -> f32 {
        let [a, b, c, d, e, f, g, h] = self.0;
        ((a + e) + (c + g)) + ((b + f) + (d + h))
    }
}

macro_rules! lane_by_lane {
    ($($of:ident $name:ident $sign:tt),*) => {$(
        impl $of for Lanes {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: Self) -> Self {
                self.with(other, |one, other| one $sign other)
            }
        }

        impl $of<f32> for Lanes {
            type Output = Self;

            #[inline(always)]
            fn $name(self, other: f32) -> Self {
                self.map(|one| one $sign other)
            }
        }
    )*};
}

lane_by_lane!(Add add +, Sub sub -, Mul mul *, Div div /);

impl AddAssign for Lanes {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}
