//! Numbers that are processed together: [`LANES`] of them, as many as the widest registers of most machines hold.
//!
//! Plain loops of fixed length. Compilers turn each into one instruction if the surrounding function is compiled for
//! such registers. Operations are not fused, so that all machines compute the same to the last bit.

use std::ops::{Add, AddAssign, Div, Mul, Sub};

/// Number of lanes.
pub const LANES: usize = 8;

/// One number in single precision per lane.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(align(32))]
pub struct Lanes(pub [f32; LANES]);

impl Lanes {
    /// All 0.
    pub const ZERO: Self = Self([0.0; LANES]);

    /// The same value in all lanes.
    #[inline(always)]
    pub fn all(value: f32) -> Self {
        Self([value; LANES])
    }

    /// Applies a function to each lane.
    #[inline(always)]
    pub fn map(self, of: impl Fn(f32) -> f32) -> Self {
        let mut to = Self::ZERO;
        for lane in 0..LANES {
            to.0[lane] = of(self.0[lane]);
        }
        to
    }

    /// Applies a function to each lane and the same lane of another.
    #[inline(always)]
    pub fn with(self, other: Self, of: impl Fn(f32, f32) -> f32) -> Self {
        let mut to = Self::ZERO;
        for lane in 0..LANES {
            to.0[lane] = of(self.0[lane], other.0[lane]);
        }
        to
    }

    /// Each lane, but at least this.
    #[inline(always)]
    pub fn at_least(self, least: f32) -> Self {
        self.map(|value| if value > least { value } else { least })
    }

    /// Each lane, but at most this.
    #[inline(always)]
    pub fn at_most(self, most: f32) -> Self {
        self.map(|value| if value < most { value } else { most })
    }

    /// The square root of each lane.
    #[inline(always)]
    pub fn sqrt(self) -> Self {
        self.map(f32::sqrt)
    }

    /// The sum of all lanes.
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
