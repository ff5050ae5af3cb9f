//! Measurement of the peak arithmetic throughput of a core.

use crate::lane::Simd;
use std::time::{Duration, Instant};

/// Floating-point operations per second of independent multiply–adds on one core, in float32, fused
/// if the instruction set supports it.
///
/// The best of many bursts within a quarter of a second. A burst takes about 0.1 ms, much less than
/// the time that a scheduler gives a thread at once: on a busy machine some bursts run without
/// interruption, and the best of them is the core's peak all the same.
pub fn multiply_adds_per_sec() -> f64 {
    const ROUNDS: u32 = 50_000;
    const AT_LEAST: Duration = Duration::from_millis(250);
    let mut best = 0.0f64;
    let started = Instant::now();
    while started.elapsed() < AT_LEAST {
        let burst = Instant::now();
        let lanes = fma_rounds(ROUNDS);
        best = best.max(f64::from(ROUNDS) * f64::from(lanes) * 2.0 / burst.elapsed().as_secs_f64());
    }
    best
}

/// Runs `rounds` rounds of independent multiply–adds and returns the number of lanes in a round.
fn fma_rounds(rounds: u32) -> u32 {
    #[cfg(target_arch = "x86_64")]
    {
        if Simd::Avx512.is_supported() {
            // SAFETY: support was checked above.
            return unsafe { x86::fma_512(rounds) };
        }
        if Simd::Avx2.is_supported() {
            // SAFETY: support was checked above.
            return unsafe { x86::fma_256(rounds) };
        }
    }
    let mut sums = [0.5f32; 64];
    for _ in 0..rounds {
        for sum in &mut sums {
            *sum = *sum * 0.999 + 0.001;
        }
    }
    std::hint::black_box(sums);
    64
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::*;

    macro_rules! fma {
        ($name:ident $feature:literal $register:ty, $width:literal, $set1:ident $fmadd:ident) => {
            #[target_feature(enable = $feature)]
            pub fn $name(rounds: u32) -> u32 {
                let (a, b) = ($set1(0.999), $set1(0.001));
                let mut sums: [$register; 12] = [$set1(0.5); 12];
                for _ in 0..rounds {
                    for sum in &mut sums {
                        *sum = $fmadd(*sum, a, b);
                    }
                }
                std::hint::black_box(sums);
                12 * $width
            }
        };
    }
    fma!(fma_256 "avx2,fma" __m256, 8, _mm256_set1_ps _mm256_fmadd_ps);
    fma!(fma_512 "avx512f" __m512, 16, _mm512_set1_ps _mm512_fmadd_ps);
}
