//! Lanes in x86 registers: AVX2 with FMA (8 strands), AVX-512 (16 strands).
//!
//! Plain arrays vectorise too, but the compiler first splits them into scalars and must then find
//! the vectors again. In functions as long as the strand solve this sometimes fails and doubles the
//! run time.

use super::{Lane, Row, asin_ratio};
use std::arch::x86_64::*;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

macro_rules! register {
    (
        $(#[$doc:meta])* $name:ident, $register:ty, $width:literal, $mask:ty;
        $add:ident $sub:ident $mul:ident $div:ident $fmadd:ident $fnmadd:ident $sqrt:ident $max:ident $min:ident
        $set1:ident $loadu:ident $storeu:ident;
        lt |$la:ident, $lb:ident| $lt:expr; select |$no:ident, $yes:ident, $m:ident| $select:expr; bits |$ma:ident| $bits:expr;
    ) => {
        $(#[$doc])*
        ///
        /// Only for code that runs under `#[target_feature]` for this instruction set.
        #[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
        #[repr(transparent)]
        pub struct $name($register);

        // SAFETY, here and below: values of this type exist only in functions that `on!`
        // instantiates for `$name` and whose callers, in the crates of this workspace, check
        // `Simd::is_supported`; the instructions access registers or slices of checked length only.
        register!(@operator $name Add add $add, Sub sub $sub, Mul mul $mul, Div div $div);

        impl Neg for $name {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                Self::splat(-1.0) * self
            }
        }

        impl AddAssign for $name {
            #[inline(always)]
            fn add_assign(&mut self, rhs: Self) {
                *self = *self + rhs;
            }
        }

        impl SubAssign for $name {
            #[inline(always)]
            fn sub_assign(&mut self, rhs: Self) {
                *self = *self - rhs;
            }
        }

        impl Lane for $name {
            type Scalar = f32;
            type Mask = $mask;
            const WIDTH: usize = $width;

            #[inline(always)]
            fn splat(value: f32) -> Self {
                Self(unsafe { $set1(value) })
            }
            #[inline(always)]
            #[expect(clippy::cast_possible_truncation, reason = "rounds to float32 on purpose")]
            fn from_f64(value: f64) -> Self {
                Self::splat(value as f32)
            }
            #[inline(always)]
            fn load(row: &Row<f32>, first: usize) -> Self {
                Self(unsafe { $loadu(row.0[first..first + $width].as_ptr()) })
            }
            #[inline(always)]
            fn store(self, row: &mut Row<f32>, first: usize) {
                unsafe { $storeu(row.0[first..first + $width].as_mut_ptr(), self.0) }
            }
            #[inline(always)]
            fn get(self, lane: usize) -> f32 {
                bytemuck::cast::<_, [f32; $width]>(self)[lane]
            }
            #[inline(always)]
            fn set(&mut self, lane: usize, value: f32) {
                bytemuck::cast_mut::<_, [f32; $width]>(self)[lane] = value;
            }
            #[inline(always)]
            fn mul_add(self, a: Self, b: Self) -> Self {
                Self(unsafe { $fmadd(self.0, a.0, b.0) })
            }
            #[inline(always)]
            fn neg_mul_add(self, a: Self, b: Self) -> Self {
                Self(unsafe { $fnmadd(self.0, a.0, b.0) })
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                Self(unsafe { $sqrt(self.0) })
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                Self(unsafe { $max(self.0, other.0) })
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                Self(unsafe { $min(self.0, other.0) })
            }
            #[inline(always)]
            fn lt(self, other: Self) -> $mask {
                let ($la, $lb) = (self.0, other.0);
                unsafe { $lt }
            }
            #[inline(always)]
            fn select(mask: $mask, yes: Self, no: Self) -> Self {
                let ($no, $yes, $m) = (no.0, yes.0, mask);
                Self(unsafe { $select })
            }
            #[inline(always)]
            fn bits(mask: $mask) -> u32 {
                let $ma = mask;
                $bits
            }
            #[inline(always)]
            fn asin_ratio(square: Self) -> Self {
                asin_ratio(square)
            }
            #[inline(always)]
            fn atan2(mut self, other: Self) -> Self {
                for lane in 0..$width {
                    self.set(lane, self.get(lane).atan2(other.get(lane)));
                }
                self
            }
        }
    };
    (@operator $name:ident $($trait:ident $method:ident $intrinsic:ident),*) => {$(
        impl $trait for $name {
            type Output = Self;
            #[inline(always)]
            fn $method(self, rhs: Self) -> Self {
                Self(unsafe { $intrinsic(self.0, rhs.0) })
            }
        }
    )*};
}

register! {
    /// Eight lanes in an AVX2 register.
    Avx2, __m256, 8, __m256;
    _mm256_add_ps _mm256_sub_ps _mm256_mul_ps _mm256_div_ps _mm256_fmadd_ps _mm256_fnmadd_ps _mm256_sqrt_ps
    _mm256_max_ps _mm256_min_ps _mm256_set1_ps _mm256_loadu_ps _mm256_storeu_ps;
    lt |a, b| _mm256_cmp_ps::<_CMP_LT_OQ>(a, b);
    select |no, yes, mask| _mm256_blendv_ps(no, yes, mask);
    bits |mask| unsafe { _mm256_movemask_ps(mask).cast_unsigned() };
}

register! {
    /// Sixteen lanes in an AVX-512 register.
    Avx512, __m512, 16, __mmask16;
    _mm512_add_ps _mm512_sub_ps _mm512_mul_ps _mm512_div_ps _mm512_fmadd_ps _mm512_fnmadd_ps _mm512_sqrt_ps
    _mm512_max_ps _mm512_min_ps _mm512_set1_ps _mm512_loadu_ps _mm512_storeu_ps;
    lt |a, b| _mm512_cmp_ps_mask::<_CMP_LT_OQ>(a, b);
    select |no, yes, mask| _mm512_mask_blend_ps(mask, no, yes);
    bits |mask| u32::from(mask);
}
