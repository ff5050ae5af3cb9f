//! Time samplings: the times of the samples of a property.
//!
//! # Theory
//! A time sampling is a period T and n times s₀ … sₙ₋₁. Sample i is at
//!
//!   t(i) = s₍ᵢ mod n₎ + ⌊i / n⌋ T.   (1)
//!
//! A uniform sampling has n = 1. A sampling without a period has one time for each sample, and the
//! largest float64 / 32 for T. The bytes are u32 (the largest number of samples), f64 T, u32 n and
//! f64 s\[n].
//!
//! # Practice
//! A property is read at the sample whose time is nearest. Times that do not increase give some
//! sample, never an error.
//!
//! # Limitations
//! There is no interpolation between samples.

use crate::{bytes::Bytes, error::FormatError};

/// The times of the samples of a property.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct TimeSampling {
    pub period_secs: f64,
    /// At least one time.
    pub times_secs: Vec<f64>,
}

impl TimeSampling {
    /// Reads all samplings of a file.
    pub fn read_all(bytes: &[u8]) -> Result<Vec<Self>, FormatError> {
        let mut bytes = Bytes::new(bytes, ".abc");
        let mut all = Vec::new();
        while bytes.left() > 0 {
            let what = "the time samplings";
            let _largest: u32 = bytes.value(what)?;
            let period_secs = bytes.value(what)?;
            let count: u32 = bytes.value(what)?;
            let times_secs: Vec<f64> = bytes.array(u64::from(count), what)?;
            if times_secs.is_empty() {
                return Err(bytes.invalid("a time sampling has no times"));
            }
            all.push(Self { period_secs, times_secs });
        }
        Ok(all)
    }

    /// Appends the bytes of the sampling, which at most `largest` samples use.
    pub fn write(&self, largest: u32, out: &mut Vec<u8>) {
        out.extend(largest.to_le_bytes());
        out.extend(self.period_secs.to_le_bytes());
        // There is one time in what is written here.
        out.extend((self.times_secs.len() as u32).to_le_bytes());
        out.extend(self.times_secs.iter().flat_map(|time| time.to_le_bytes()));
    }

    /// The time of sample `index` in seconds, equation (1).
    pub fn time_secs(&self, index: u32) -> f64 {
        let (index, n) = (index as usize, self.times_secs.len());
        let cycles = index / n;
        // Without a period, 0 times infinity must not matter.
        let start = if cycles == 0 { 0.0 } else { cycles as f64 * self.period_secs };
        self.times_secs[index % n] + start
    }

    /// The index below `count` (1 or more) whose time is nearest to `time_secs`.
    pub fn nearest(&self, time_secs: f64, count: u32) -> u32 {
        // The first sample that is not before the time.
        let [mut low, mut high] = [0, count - 1];
        while low < high {
            let middle = low + (high - low) / 2;
            if self.time_secs(middle) < time_secs { low = middle + 1 } else { high = middle }
        }
        let distance = |index| (self.time_secs(index) - time_secs).abs();
        if low > 0 && distance(low - 1) <= distance(low) { low - 1 } else { low }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_sample_is_found() {
        let uniform = TimeSampling { period_secs: 0.5, times_secs: vec![1.0] };
        let cyclic = TimeSampling { period_secs: 1.0, times_secs: vec![1.0, 1.5] };
        let listed = TimeSampling { period_secs: f64::MAX / 32.0, times_secs: vec![1.0, 1.5, 2.0, 2.5] };
        for sampling in [uniform, cyclic, listed] {
            for (time, index) in [(-9.0, 0), (1.0, 0), (1.3, 1), (1.7, 1), (2.4, 3), (1e9, 3)] {
                assert_eq!(sampling.nearest(time, 4), index, "{time}");
            }
            assert_eq!(sampling.time_secs(3), 2.5);
        }
    }
}
