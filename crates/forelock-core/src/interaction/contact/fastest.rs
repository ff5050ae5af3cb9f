//! Which of many are the largest, without sorting them.

/// Bits of a float below its exponent and the three after it.
pub const BIN_BITS: u32 = 20;
/// Bins of non-negative floats: an exponent and three bits.
pub const BINS: usize = 1 << (31 - BIN_BITS);

/// How many non-negative numbers lie in each eighth of a binade.
#[derive(Clone, Debug)]
pub(crate) struct Histogram(Box<[u32; BINS]>);

/// The bin in which the largest so many end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Last {
    bin: u32,
    /// How many of those in it belong to the largest, and how many are in it.
    pub room: usize,
    pub own: usize,
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

    /// Counts also what `other` counted.
    pub fn join(&mut self, other: &Self) {
        self.0.iter_mut().zip(&*other.0).for_each(|(own, more)| *own += more);
    }

    /// Where the `most` largest end; of no more than these, at the lowest bin.
    pub fn last_of(&self, most: usize) -> Last {
        let mut room = most;
        for (bin, &own) in (0..BINS as u32).zip(&*self.0).rev() {
            let own = own as usize;
            if own > room {
                return Last { bin, room, own };
            }
            room -= own;
        }
        Last { bin: 0, room, own: 0 }
    }
}

impl Last {
    /// Whether `x` is in a higher bin, in this one, or in a lower one.
    #[inline]
    pub fn against(&self, x: f32) -> std::cmp::Ordering {
        bin(x).cmp(&self.bin)
    }

    /// What the numbers of all higher bins exceed or equal, and those of this one do not.
    pub fn bound(&self) -> f32 {
        f32::from_bits((self.bin + 1) << BIN_BITS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cmp::Ordering::{Equal, Greater};

    #[test]
    fn the_largest_end_where_sorting_has_them_end() {
        let numbers: Vec<f32> = (0..1000u16).map(|k| (f32::from(k) * 0.37).sin().powi(8)).collect();
        let mut halves = [Histogram::default(), Histogram::default()];
        for (k, &x) in numbers.iter().enumerate() {
            halves[k % 2].add(x);
        }
        let [mut all, other] = halves;
        all.join(&other);
        for most in [0, 1, 10, 500, 999] {
            let last = all.last_of(most);
            let above = numbers.iter().filter(|&&x| last.against(x) == Greater).count();
            let own = numbers.iter().filter(|&&x| last.against(x) == Equal).count();
            assert_eq!((above + last.room, own), (most, last.own));
            assert!(last.room < own);
            assert_eq!(numbers.iter().filter(|&&x| x >= last.bound()).count(), above);
        }
        assert_eq!(all.last_of(1000), Last { bin: 0, room: 0, own: 0 });
    }
}
