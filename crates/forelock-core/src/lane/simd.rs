//! The instruction sets that lane-generic functions are compiled for, and the choice among them at
//! run time.

/// An instruction set and a width.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum Simd {
    /// The best that the processor has.
    #[default]
    Auto,
    /// What every processor of this architecture has, one strand at a time.
    Scalar,
    /// What every processor of this architecture has, 4 strands.
    Portable,
    /// AVX2 and FMA, 1 strand: for comparing widths.
    Avx2x1,
    /// AVX2 and FMA, 4 strands: for comparing widths.
    Avx2x4,
    /// AVX2 and FMA, 8 strands.
    Avx2,
    /// AVX2 and FMA, 16 strands in two registers: for comparing widths.
    Avx2x16,
    /// AVX-512, 16 strands.
    Avx512,
}

impl Simd {
    /// All but `Auto`, narrow to wide.
    pub const ALL: [Self; 7] =
        [Self::Scalar, Self::Portable, Self::Avx2x1, Self::Avx2x4, Self::Avx2, Self::Avx2x16, Self::Avx512];

    /// Whether this processor can run it.
    pub fn is_supported(self) -> bool {
        match self {
            Self::Auto | Self::Scalar | Self::Portable => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2x1 | Self::Avx2x4 | Self::Avx2 | Self::Avx2x16 => {
                is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("fma")
            }
            #[cfg(not(target_arch = "x86_64"))]
            _ => false,
        }
    }

    /// This choice, or for `Auto` the best one supported.
    pub fn resolve(self) -> Self {
        if self != Self::Auto {
            return self;
        }
        [Self::Avx512, Self::Avx2].into_iter().find(|s| s.is_supported()).unwrap_or(Self::Portable)
    }

    /// The best that the processor has with at most eight lanes: for functions that turn rows of
    /// lanes into registers of eight numbers and back, where loads of sixteen lanes would wait for
    /// two stores.
    pub(crate) fn up_to_eight() -> Self {
        if Self::Avx2.is_supported() { Self::Avx2 } else { Self::Portable }
    }
}

/// Runs `f` with the processor's AVX2, if it has it. Only what is inlined into `f` is compiled for
/// it. Results do not depend on it: the compiler fuses no multiplications with additions.
#[inline(always)]
pub(crate) fn widest<R>(f: impl FnOnce() -> R) -> R {
    #[cfg(target_arch = "x86_64")]
    {
        // A function of its own: what the compiler merges with its caller is often slower.
        #[target_feature(enable = "avx2")]
        #[inline(never)]
        fn with_avx2<R>(f: impl FnOnce() -> R) -> R {
            f()
        }
        if is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has AVX2.
            return unsafe { with_avx2(f) };
        }
    }
    f()
}

/// Whether the target has fused multiply–add without asking.
pub const BASELINE_FMA: bool = cfg!(any(target_arch = "aarch64", target_feature = "fma"));

/// `$text` for lanes `$lane`, with `$features`.
#[cfg(target_arch = "x86_64")]
#[doc(hidden)]
#[macro_export]
macro_rules! with_features {
    ($features:literal, $lane:ty, $text:ident($($name:ident: $type:ty),*) $(-> $found:ty)?) => {{
        #[target_feature(enable = $features)]
        fn with_features($($name: $type),*) $(-> $found)? {
            $text::<$lane>($($name),*)
        }
        with_features
    }};
}
#[cfg(target_arch = "x86_64")]
pub use with_features;

/// `$text`, a function of float32 lanes, compiled for the instruction set and width `$simd` (a
/// supported one, not `Auto`). Unsafe to call on a processor without that instruction set. For
/// crates of this workspace.
#[doc(hidden)]
#[macro_export]
macro_rules! on {
    ($simd:ident, $text:ident $takes:tt $(-> $found:ty)?) => {
        match $simd {
            $crate::lane::Simd::Scalar => $text::<$crate::lane::Pack<1, { $crate::lane::BASELINE_FMA }>>,
            #[cfg(target_arch = "x86_64")]
            $crate::lane::Simd::Avx2x1 => $crate::lane::with_features!("avx2,fma", $crate::lane::Pack<1, true>, $text $takes $(-> $found)?),
            #[cfg(target_arch = "x86_64")]
            $crate::lane::Simd::Avx2x4 => $crate::lane::with_features!("avx2,fma", $crate::lane::Pack<4, true>, $text $takes $(-> $found)?),
            #[cfg(target_arch = "x86_64")]
            $crate::lane::Simd::Avx2 => $crate::lane::with_features!("avx2,fma", $crate::lane::Avx2, $text $takes $(-> $found)?),
            #[cfg(target_arch = "x86_64")]
            $crate::lane::Simd::Avx2x16 => $crate::lane::with_features!("avx2,fma", $crate::lane::Pack<16, true>, $text $takes $(-> $found)?),
            #[cfg(target_arch = "x86_64")]
            $crate::lane::Simd::Avx512 => $crate::lane::with_features!(
                "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma",
                $crate::lane::Avx512,
                $text $takes $(-> $found)?
            ),
            _ => $text::<$crate::lane::Pack<4, { $crate::lane::BASELINE_FMA }>>,
        }
    };
}
pub use on;
