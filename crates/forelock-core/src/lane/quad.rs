//! Four float32 numbers in one register, for code that gathers and scatters two pairs of numbers at
//! a time.
//!
//! Every processor that Forelock supports has registers of four numbers, so no selection at run
//! time is needed. Plain arrays vectorise too, but not in functions with as many loads as the
//! stencils of the grid.

#[cfg(target_arch = "x86_64")]
use std::arch::x86_64::*;
use std::ops::{Add, Mul};

/// Four numbers in float32.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub(crate) struct Quad(#[cfg(target_arch = "x86_64")] __m128, #[cfg(not(target_arch = "x86_64"))] [f32; 4]);

#[cfg(target_arch = "x86_64")]
impl Quad {
    #[inline(always)]
    pub fn new(x: [f32; 4]) -> Self {
        Self(bytemuck::cast(x))
    }
    #[inline(always)]
    pub fn splat(x: f32) -> Self {
        // SAFETY: every x86-64 processor has SSE.
        Self(unsafe { _mm_set1_ps(x) })
    }
    #[inline(always)]
    pub fn to_array(self) -> [f32; 4] {
        bytemuck::cast(self.0)
    }
}

#[cfg(target_arch = "x86_64")]
impl Add for Quad {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        // SAFETY: every x86-64 processor has SSE.
        Self(unsafe { _mm_add_ps(self.0, other.0) })
    }
}

#[cfg(target_arch = "x86_64")]
impl Mul for Quad {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        // SAFETY: every x86-64 processor has SSE.
        Self(unsafe { _mm_mul_ps(self.0, other.0) })
    }
}

#[cfg(not(target_arch = "x86_64"))]
impl Quad {
    #[inline(always)]
    pub fn new(x: [f32; 4]) -> Self {
        Self(x)
    }
    #[inline(always)]
    pub fn splat(x: f32) -> Self {
        Self([x; 4])
    }
    #[inline(always)]
    pub fn to_array(self) -> [f32; 4] {
        self.0
    }
}

#[cfg(not(target_arch = "x86_64"))]
impl Add for Quad {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self([0, 1, 2, 3].map(|k| self.0[k] + other.0[k]))
    }
}

#[cfg(not(target_arch = "x86_64"))]
impl Mul for Quad {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self([0, 1, 2, 3].map(|k| self.0[k] * other.0[k]))
    }
}

impl Quad {
    /// Reads two adjacent pairs.
    #[inline(always)]
    pub fn load(pairs: &[[f32; 2]; 2]) -> Self {
        Self::new(bytemuck::cast(*pairs))
    }

    /// Writes two adjacent pairs.
    #[inline(always)]
    pub fn store(self, pairs: &mut [[f32; 2]; 2]) {
        *pairs = bytemuck::cast(self.to_array());
    }
}
