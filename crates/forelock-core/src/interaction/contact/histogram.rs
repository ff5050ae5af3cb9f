//! Selects the largest of many numbers without sorting them.

/// Bits of a float below its exponent and the three after it.
pub const BIN_BITS: u32 = 20;
/// Bins of non-negative floats: an exponent and three bits.
pub const BINS: usize = 1 << (31 - BIN_BITS);

/// Counts of non-negative numbers in bins, eight for each binade.
#[derive(Clone, Debug)]
pub(crate) struct Histogram(Box<[u32; BINS]>);

/// The bin that holds the last of the largest numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Cutoff {
    bin: u32,
    /// How many numbers of this bin belong to the largest.
    pub selected: usize,
    /// How many numbers it holds.
    pub count: usize,
}

impl Default for Histogram {
    fn default() -> Self {
        Self(Box::new([0; BINS]))
    }
}

#[inline]
fn bin(x: f32) -> u32 {
    x.to_bits() >> BIN_BITS
}

impl Histogram {
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.0)
    }

    pub fn clear(&mut self) {
        self.0.fill(0);
    }

    #[inline]
    pub fn add(&mut self, x: f32) {
        self.0[bin(x) as usize] += 1;
    }

    /// Adds the counts of `other`.
    pub fn merge(&mut self, other: &Self) {
        self.0.iter_mut().zip(&*other.0).for_each(|(own, more)| *own += more);
    }

    /// The bin that holds the last of the `most` largest numbers; the lowest bin if there are no
    /// more than `most`.
    pub fn cutoff(&self, most: usize) -> Cutoff {
        let mut room = most;
        for (bin, &own) in (0..BINS as u32).zip(&*self.0).rev() {
            let own = own as usize;
            if own > room {
                return Cutoff { bin, selected: room, count: own };
            }
            room -= own;
        }
        Cutoff { bin: 0, selected: room, count: 0 }
    }
}

impl Cutoff {
    /// Compares the bin of `x` with this one.
    #[inline]
    pub fn compare(&self, x: f32) -> std::cmp::Ordering {
        bin(x).cmp(&self.bin)
    }

    /// The smallest number of this bin.
    pub fn floor(&self) -> f32 {
        f32::from_bits(self.bin << BIN_BITS)
    }

    /// The smallest number of the next higher bin.
    pub fn bound(&self) -> f32 {
        f32::from_bits((self.bin + 1) << BIN_BITS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cmp::Ordering::{Equal, Greater};

    #[test]
    fn the_cutoff_agrees_with_sorting() {
        let numbers: Vec<f32> = (0..1000u16).map(|k| (f32::from(k) * 0.37).sin().powi(8)).collect();
        let mut halves = [Histogram::default(), Histogram::default()];
        for (k, &x) in numbers.iter().enumerate() {
            halves[k % 2].add(x);
        }
        let [mut all, other] = halves;
        all.merge(&other);
        for most in [0, 1, 10, 500, 999] {
            let last = all.cutoff(most);
            let above = numbers.iter().filter(|&&x| last.compare(x) == Greater).count();
            let own = numbers.iter().filter(|&&x| last.compare(x) == Equal).count();
            assert_eq!((above + last.selected, own), (most, last.count));
            assert!(last.selected < own);
            assert_eq!(numbers.iter().filter(|&&x| x >= last.bound()).count(), above);
        }
        assert_eq!(all.cutoff(1000), Cutoff { bin: 0, selected: 0, count: 0 });
    }
}
