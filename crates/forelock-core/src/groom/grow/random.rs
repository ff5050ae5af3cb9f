//! Seeded random numbers and a sine that are the same on every machine: they use integer and
//! IEEE-exact arithmetic only.

/// The SplitMix64 generator (Steele, Lea and Flood 2014, "Fast splittable pseudorandom number
/// generators").
#[derive(Clone, Copy, Debug)]
pub(crate) struct Random(u64);

impl Random {
    /// An independent generator for each `stream` of a `seed`.
    pub(crate) fn new(seed: u64, stream: u64) -> Self {
        Self(mix(seed ^ mix(stream.wrapping_add(0x9E37_79B9_7F4A_7C15))))
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        mix(self.0)
    }

    /// A uniform number in [0, 1), a multiple of 2⁻²⁴.
    pub(crate) fn unit(&mut self) -> f32 {
        (self.next() >> 40) as f32 / 16_777_216.0
    }

    /// A uniform number in [-1, 1).
    pub(crate) fn signed(&mut self) -> f32 {
        2.0 * self.unit() - 1.0
    }

    /// A uniform point in the cube [-1, 1)³.
    pub(crate) fn cube(&mut self) -> glam::Vec3 {
        let (x, y) = (self.signed(), self.signed());
        glam::Vec3::new(x, y, self.signed())
    }
}

/// A bijection of 64-bit words; every output bit depends on every input bit.
pub(crate) fn mix(word: u64) -> u64 {
    let word = (word ^ (word >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let word = (word ^ (word >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    word ^ (word >> 31)
}

/// (sin, cos) of an angle in radians, accurate to 2e-7 for angles of less than a thousand turns.
pub(crate) fn sin_cos(angle: f64) -> (f32, f32) {
    let turns = angle / std::f64::consts::TAU;
    (sin_turns(turns), sin_turns(turns + 0.25))
}

fn sin_turns(turns: f64) -> f32 {
    // Reduction to [-1/4, 1/4] turn by symmetry, then a Taylor polynomial of degree 11.
    let t = turns - turns.round();
    let t = if t.abs() > 0.25 { 0.5f64.copysign(t) - t } else { t };
    let x = t * std::f64::consts::TAU;
    let q = x * x;
    let series = 1.0 - q / 6.0 * (1.0 - q / 20.0 * (1.0 - q / 42.0 * (1.0 - q / 72.0 * (1.0 - q / 110.0))));
    (x * series) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_and_cosine_are_accurate() {
        for i in -4000..4000 {
            let angle = f64::from(i) * 0.01;
            let (sin, cos) = sin_cos(angle);
            assert!((f64::from(sin) - angle.sin()).abs() < 2e-7, "{angle}");
            assert!((f64::from(cos) - angle.cos()).abs() < 2e-7, "{angle}");
        }
    }

    #[test]
    fn uniform_numbers_have_the_right_moments() {
        let mut random = Random::new(1, 2);
        let n = 100_000;
        let (mut mean, mut square) = (0.0, 0.0);
        for _ in 0..n {
            let x = f64::from(random.signed());
            mean += x / f64::from(n);
            square += x * x / f64::from(n);
        }
        assert!(mean.abs() < 0.01 && (square - 1.0 / 3.0).abs() < 0.005, "{mean} {square}");
    }
}
