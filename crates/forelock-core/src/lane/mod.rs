//! SIMD lanes: one implementation for scalar and SIMD code.
//!
//! # Theory
//! A strand is a chain, so its solve is sequential; strands are independent of each other, so a
//! SIMD register holds one strand in each lane. Every stage of the solvers is written once, generic
//! over [`Lane`], and instantiated with `f64` (the specification that the golden files check), with
//! [`Pack`]s of `f32` for each instruction set, and with `Pack<1, _>` for single strands.
//!
//! # Practice
//! [`Pack`] is a plain array for any width; the wide registers of x86 have dedicated types. In both
//! cases **all code must be inlined** into the function that enables the instruction set, so
//! generic lane code uses no closures.
//!
//! # Limitations
//! With `FMA = false` a product is rounded before the addition, so the portable path gives
//! different results from the others; widths with the same value of `FMA` give bit-identical
//! results.

#![expect(clippy::needless_range_loop, reason = "loops with one index for several arrays vectorise")]

mod math;
pub mod peak;
mod simd;
#[cfg(target_arch = "x86_64")]
mod x86;

pub use math::{Mat3, Quat, Sym3, V3};
pub use simd::Simd;
pub(crate) use simd::widest;
#[cfg(target_arch = "x86_64")]
#[doc(hidden)]
pub use simd::with_features;
#[doc(hidden)]
pub use simd::{BASELINE_FMA, on};
#[cfg(target_arch = "x86_64")]
#[doc(hidden)]
pub use x86::{Avx2, Avx512};

use num_traits::Float;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

/// Strands in one block of packed memory: one cache line of `f32`, and the width of the widest
/// register.
pub const LANES: usize = 16;

/// One row of packed memory: the same component of the same particle for [`LANES`] strands.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
pub struct Row<T>(pub [T; LANES]);

/// The scalar types of lanes: `f32` and `f64` only.
pub trait Real:
    Float + bytemuck::Pod + Default + Send + Sync + std::fmt::Debug + sealed::Sealed + 'static
{
}
impl Real for f32 {}
impl Real for f64 {}

mod sealed {
    pub trait Sealed {}
    impl Sealed for f32 {}
    impl Sealed for f64 {}
}

// SAFETY: 16 floats fill 64 or 128 bytes, a multiple of the alignment, so there is no padding; any
// bit pattern is a valid float.
unsafe impl<T: Real> bytemuck::Zeroable for Row<T> {}
// SAFETY: as above.
unsafe impl<T: Real> bytemuck::Pod for Row<T> {}

/// One number for each of [`Lane::WIDTH`] strands.
pub trait Lane:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + bytemuck::Pod
    + Send
    + Sync
    + 'static
{
    /// The type of the number in one lane.
    type Scalar: Real;
    /// One truth value for each lane.
    type Mask: Copy;
    /// Number of lanes; divides [`LANES`].
    const WIDTH: usize;

    /// Sets every lane to the same number.
    fn splat(value: Self::Scalar) -> Self;
    /// Sets every lane to the same number, rounded from float64.
    fn from_f64(value: f64) -> Self;
    /// Reads lanes `first..first + WIDTH` of a row.
    fn load(row: &Row<Self::Scalar>, first: usize) -> Self;
    /// Writes lanes `first..first + WIDTH` of a row.
    fn store(self, row: &mut Row<Self::Scalar>, first: usize);
    /// The value of one lane.
    fn get(self, lane: usize) -> Self::Scalar;
    /// Sets the value of one lane.
    fn set(&mut self, lane: usize, value: Self::Scalar);
    /// `self · a + b`, with a single rounding if the type uses fused multiply-add.
    fn mul_add(self, a: Self, b: Self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// The larger value; `other` where `self` is NaN.
    fn max(self, other: Self) -> Self;
    /// The smaller value; `other` where `self` is NaN.
    fn min(self, other: Self) -> Self;
    /// `self < other` in each lane.
    fn lt(self, other: Self) -> Self::Mask;
    /// `yes` where the mask holds, `no` elsewhere.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
    /// The mask as bits; lane 0 is the lowest bit.
    fn bits(mask: Self::Mask) -> u32;
    /// asin(u)/u for u = √`square`, with `square` in 0–1: the ratio of half an angle to its sine.
    fn asin_ratio(square: Self) -> Self;
    /// The angle of the point (`x`, `y`) = (`other`, `self`), computed lane by lane. Slow: used by
    /// non-default options only.
    fn atan2(self, other: Self) -> Self;

    /// Whether the mask holds in every lane.
    #[inline(always)]
    fn all(mask: Self::Mask) -> bool {
        Self::bits(mask) == u32::MAX >> (32 - Self::WIDTH)
    }

    /// Zero in every lane.
    #[inline(always)]
    fn zero() -> Self {
        Self::from_f64(0.0)
    }

    /// One in every lane.
    #[inline(always)]
    fn one() -> Self {
        Self::from_f64(1.0)
    }

    /// `b − self · a`.
    #[inline(always)]
    fn neg_mul_add(self, a: Self, b: Self) -> Self {
        (-self).mul_add(a, b)
    }
}

/// `W` numbers in float32, one for each strand. `FMA` says whether [`Lane::mul_add`] rounds once
/// (requires hardware support) or twice.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub struct Pack<const W: usize, const FMA: bool>([f32; W]);

macro_rules! lanewise {
    ($($trait:ident $method:ident $op:tt),*) => {$(
        impl<const W: usize, const FMA: bool> $trait for Pack<W, FMA> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, rhs: Self) -> Self {
                let mut out = self.0;
                for k in 0..W {
                    out[k] = self.0[k] $op rhs.0[k];
                }
                Self(out)
            }
        }
    )*};
}
lanewise!(Add add +, Sub sub -, Mul mul *, Div div /);

impl<const W: usize, const FMA: bool> Neg for Pack<W, FMA> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        let mut out = self.0;
        for x in &mut out {
            *x = -*x;
        }
        Self(out)
    }
}

impl<const W: usize, const FMA: bool> AddAssign for Pack<W, FMA> {
    #[inline(always)]
    fn add_assign(&mut self, rhs: Self) {
        *self = *self + rhs;
    }
}

impl<const W: usize, const FMA: bool> SubAssign for Pack<W, FMA> {
    #[inline(always)]
    fn sub_assign(&mut self, rhs: Self) {
        *self = *self - rhs;
    }
}

impl<const W: usize, const FMA: bool> Pack<W, FMA> {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let mut out = self.0;
        for k in 0..W {
            out[k] = f(self.0[k], other.0[k]);
        }
        Self(out)
    }
}

impl<const W: usize, const FMA: bool> Lane for Pack<W, FMA> {
    type Scalar = f32;
    type Mask = [bool; W];
    const WIDTH: usize = W;

    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self([value; W])
    }
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "rounds to float32 on purpose")]
    fn from_f64(value: f64) -> Self {
        Self([value as f32; W])
    }
    #[inline(always)]
    fn load(row: &Row<f32>, first: usize) -> Self {
        let mut out = [0.0; W];
        out.copy_from_slice(&row.0[first..first + W]);
        Self(out)
    }
    #[inline(always)]
    fn store(self, row: &mut Row<f32>, first: usize) {
        row.0[first..first + W].copy_from_slice(&self.0);
    }
    #[inline(always)]
    fn get(self, lane: usize) -> f32 {
        self.0[lane]
    }
    #[inline(always)]
    fn set(&mut self, lane: usize, value: f32) {
        self.0[lane] = value;
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        let mut out = self.0;
        for k in 0..W {
            out[k] = if FMA { self.0[k].mul_add(a.0[k], b.0[k]) } else { self.0[k] * a.0[k] + b.0[k] };
        }
        Self(out)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        let mut out = self.0;
        for x in &mut out {
            *x = x.sqrt();
        }
        Self(out)
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn lt(self, other: Self) -> [bool; W] {
        let mut out = [false; W];
        for k in 0..W {
            out[k] = self.0[k] < other.0[k];
        }
        out
    }
    #[inline(always)]
    fn select(mask: [bool; W], yes: Self, no: Self) -> Self {
        let mut out = no.0;
        for k in 0..W {
            out[k] = if mask[k] { yes.0[k] } else { no.0[k] };
        }
        Self(out)
    }
    #[inline(always)]
    fn atan2(self, other: Self) -> Self {
        self.zip(other, f32::atan2)
    }
    #[inline(always)]
    fn bits(mask: [bool; W]) -> u32 {
        let mut bits = 0;
        for k in 0..W {
            bits |= u32::from(mask[k]) << k;
        }
        bits
    }

    #[inline(always)]
    fn asin_ratio(square: Self) -> Self {
        asin_ratio(square)
    }
}

/// asin(u)/u in float32: a polynomial for u in 0–½ and the half-angle identity asin u = π/2 − 2
/// asin √((1−u)/2) above. The relative error is below 1e-6 (5e-6 near u = 1).
#[inline(always)]
fn asin_ratio<L: Lane<Scalar = f32>>(square: L) -> L {
    let half = L::splat(0.5);
    let quarter = L::splat(0.25);
    let small = square.lt(quarter);
    if L::all(small) {
        return asin_polynomial(square); // the usual case: no strand deviates by 60° from its ghost
    }
    let u = square.sqrt();
    let folded = (L::one() - u) * half;
    let z = L::select(small, square, folded);
    let ratio = asin_polynomial(z);
    let above = (L::splat(std::f32::consts::FRAC_PI_2) - z.sqrt() * ratio * L::splat(2.0)) / u.max(half);
    L::select(small, ratio, above)
}

#[inline(always)]
fn asin_polynomial<L: Lane<Scalar = f32>>(z: L) -> L {
    let mut ratio = L::splat(ASIN_RATIO[4]);
    for k in [3, 2, 1, 0] {
        ratio = ratio.mul_add(z, L::splat(ASIN_RATIO[k]));
    }
    ratio
}

/// Coefficients of asin(√z)/√z for 0 ≤ z ≤ ¼: interpolation at Chebyshev nodes, constant term
/// rounded to 1; relative error 2e-7.
pub const ASIN_RATIO: [f32; 5] = [1.0, 1.666_522e-1, 7.545_346e-2, 3.979_444e-2, 5.035_768e-2];

macro_rules! scalar_lane {
    ($float:ty) => {
        impl Lane for $float {
            type Scalar = $float;
            type Mask = bool;
            const WIDTH: usize = 1;

            #[inline(always)]
            fn splat(value: $float) -> Self {
                value
            }
            #[inline(always)]
            fn from_f64(value: f64) -> Self {
                value
            }
            #[inline(always)]
            fn load(row: &Row<$float>, first: usize) -> Self {
                row.0[first]
            }
            #[inline(always)]
            fn store(self, row: &mut Row<$float>, first: usize) {
                row.0[first] = self;
            }
            #[inline(always)]
            fn get(self, _lane: usize) -> $float {
                self
            }
            #[inline(always)]
            fn set(&mut self, _lane: usize, value: $float) {
                *self = value;
            }
            #[inline(always)]
            fn mul_add(self, a: Self, b: Self) -> Self {
                self * a + b
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                <$float>::sqrt(self)
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                if self > other { self } else { other }
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                if self < other { self } else { other }
            }
            #[inline(always)]
            fn lt(self, other: Self) -> bool {
                self < other
            }
            #[inline(always)]
            fn select(mask: bool, yes: Self, no: Self) -> Self {
                if mask { yes } else { no }
            }
            #[inline(always)]
            fn atan2(self, other: Self) -> Self {
                <$float>::atan2(self, other)
            }
            #[inline(always)]
            fn bits(mask: bool) -> u32 {
                mask.into()
            }
            #[inline(always)]
            fn asin_ratio(square: Self) -> Self {
                let u = square.sqrt();
                if u < 1e-4 { 1.0 + square / 6.0 } else { u.min(1.0).asin() / u }
            }
        }
    };
}
scalar_lane!(f64);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn asin_ratio_is_accurate() {
        let (mut worst, mut worst_near_pi) = (0.0f64, 0.0f64);
        for k in 0..=100_000u32 {
            #[expect(clippy::cast_possible_truncation, reason = "the precision of the lane")]
            let square = (f64::from(k) / 1e5) as f32;
            let got = Pack::<1, false>::asin_ratio(Pack([square])).0[0];
            let error = (f64::from(got) / f64::asin_ratio(square.into()) - 1.0).abs();
            // Near u = 1 the derivative is infinite, so the rounding of u dominates.
            let place = if square < 0.99 { &mut worst } else { &mut worst_near_pi };
            *place = place.max(error);
        }
        assert!(worst < 1e-6 && worst_near_pi < 5e-6, "{worst:e} {worst_near_pi:e}");
        assert!((f64::asin_ratio(1.0) - std::f64::consts::FRAC_PI_2).abs() < 1e-15);
    }

    #[test]
    fn masks_select_by_lane() {
        let a = Pack::<4, false>([1.0, 2.0, 3.0, f32::NAN]);
        let b = Pack::<4, false>::splat(2.5);
        assert_eq!(Lane::max(a, b).0, [2.5, 2.5, 3.0, 2.5]);
        assert_eq!(Pack::select(a.lt(b), a, b).0, [1.0, 2.0, 2.5, 2.5]);
    }
}
