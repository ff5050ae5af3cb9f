//! Locks: groups of neighbouring strands that share their mean code.
//!
//! # Theory
//! Next to its own code a strand receives the mean code of its lock, so that the network knows the
//! hair around it (Neuralocks, section on locks). A lock is a leaf of a k-d tree over the roots'
//! uv coordinates: a set of more than 64 roots is split at the median along the axis of its larger
//! extent.
//!
//! # Practice
//! The split is by rank (⌊n/2⌋ roots go left) after a stable sort, so equal coordinates and
//! duplicate roots do no harm; they keep the order of the roots.
//!
//! # Limitations
//! Locks know nothing of partings: two sides of one may share a lock.

use forelock_core::lane::Real;
use std::num::NonZeroUsize;

/// The most strands of a lock.
pub const LOCK_SIZE: NonZeroUsize = NonZeroUsize::new(64).unwrap();

/// Why roots have no locks, or codes no means.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LocksError {
    /// There are no roots.
    #[error("there are no roots to divide into locks")]
    Empty,
    /// There are more roots than labels.
    #[error("{0} roots are more than locks can label: at most 2³² − 1")]
    TooMany(usize),
    /// A coordinate is not finite.
    #[error("the uv coordinates of root {0} are not finite")]
    Coordinates(usize),
    /// A code's width is zero.
    #[error("codes must have at least one number a strand")]
    Width,
    /// The number of code numbers does not suit the strands.
    #[error("{found} numbers of codes were given; {strands} strands of {width} numbers need {expected}", expected = strands.saturating_mul(*width))]
    Codes {
        /// Numbers given.
        found: usize,
        /// Strands of the locks.
        strands: usize,
        /// Numbers of a code.
        width: usize,
    },
}

/// Strands divided into locks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Locks {
    labels: Vec<u32>,
    count: usize,
}

impl Locks {
    /// Divides roots at `uv` into locks of at most `largest` strands ([`LOCK_SIZE`] in the paper's
    /// setting). Locks are numbered depth first, the lower half before the upper one.
    ///
    /// # Errors
    /// If there are no roots, or more than 2³² − 1, or one has coordinates that are not finite.
    pub fn new<T: Real>(uv: &[[T; 2]], largest: NonZeroUsize) -> Result<Self, LocksError> {
        if uv.is_empty() {
            return Err(LocksError::Empty);
        }
        let roots = u32::try_from(uv.len()).map_err(|_| LocksError::TooMany(uv.len()))?;
        if let Some(root) = uv.iter().position(|p| !(p[0].is_finite() && p[1].is_finite())) {
            return Err(LocksError::Coordinates(root));
        }
        let mut order: Vec<u32> = (0..roots).collect();
        let mut locks = Self { labels: vec![0; uv.len()], count: 0 };
        locks.split(uv, &mut order, largest.get());
        Ok(locks)
    }

    /// Labels the roots in `order`. The recursion is at most 32 deep: each level halves them.
    fn split<T: Real>(&mut self, uv: &[[T; 2]], order: &mut [u32], largest: usize) {
        if order.len() <= largest {
            for &root in &*order {
                self.labels[root as usize] = self.count as u32;
            }
            self.count += 1;
            return;
        }
        let axis = usize::from(extent(uv, order, 1) > extent(uv, order, 0));
        // Coordinates are finite, so each pair has an order.
        order.sort_by(|&a, &b| {
            let (a, b) = (uv[a as usize][axis], uv[b as usize][axis]);
            a.partial_cmp(&b).unwrap_or(std::cmp::Ordering::Equal)
        });
        let (lower, upper) = order.split_at_mut(order.len() / 2);
        self.split(uv, lower, largest);
        self.split(uv, upper, largest);
    }

    /// The lock of each strand, from 0 to [`Self::count`] − 1.
    pub fn labels(&self) -> &[u32] {
        &self.labels
    }

    /// The number of locks.
    pub fn count(&self) -> usize {
        self.count
    }

    /// The mean code of each lock, shape \[locks, `width`\]. `codes` holds `width` numbers for each
    /// strand. Sums are taken in float64, in the order of the strands.
    ///
    /// # Errors
    /// If `width` is zero, or `codes` does not hold `width` numbers a strand.
    pub fn mean_codes<T: Real>(&self, codes: &[T], width: usize) -> Result<Vec<T>, LocksError> {
        if width == 0 {
            return Err(LocksError::Width);
        }
        let strands = self.labels.len();
        if strands.checked_mul(width) != Some(codes.len()) {
            return Err(LocksError::Codes { found: codes.len(), strands, width });
        }
        let mut sums = vec![0.0f64; self.count * width];
        let mut sizes = vec![0u32; self.count];
        for (code, &lock) in codes.chunks_exact(width).zip(&self.labels) {
            let lock = lock as usize;
            sizes[lock] += 1;
            for (sum, &z) in sums[lock * width..][..width].iter_mut().zip(code) {
                *sum += z.to_f64().unwrap_or(f64::NAN);
            }
        }
        let mean = |(i, sum): (usize, f64)| sum / f64::from(sizes[i / width]);
        let cast = |mean: f64| T::from(mean).unwrap_or_else(T::nan);
        Ok(sums.into_iter().enumerate().map(mean).map(cast).collect())
    }
}

/// The extent of the roots in `order` along an axis of uv.
fn extent<T: Real>(uv: &[[T; 2]], order: &[u32], axis: usize) -> T {
    let values = || order.iter().map(|&root| uv[root as usize][axis]);
    values().fold(T::neg_infinity(), T::max) - values().fold(T::infinity(), T::min)
}
