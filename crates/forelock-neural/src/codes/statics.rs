//! The static inputs of the network: what it knows of a strand in every frame.

use super::{LOCK_SIZE, Locks, LocksError};

/// The network's inputs of the strands of one groom: `[strands, 2 + 2 code]`, a strand after the
/// other. A strand has the `uv` of its root, its code and the mean code of its lock (Neuralocks,
/// Sec. 4.2), both over the `deviation` of codes.
///
/// `codes` are `[strands, code]`. [`Locks`] are formed over all the strands, so the list must hold
/// a whole groom and no other one.
///
/// # Errors
/// If there are no strands, a root's uv is not finite, or `codes` has not the same number of
/// numbers, at least one, for each strand.
///
/// ```
/// use forelock_neural::codes::static_inputs;
///
/// // Two strands of one lock, codes of one number: 1 and 3, whose mean is 2.
/// let inputs = static_inputs(&[[0.0, 0.5], [0.1, 0.5]], &[1.0, 3.0], 2.0)?;
/// assert_eq!(inputs, [0.0, 0.5, 0.5, 1.0, 0.1, 0.5, 1.5, 1.0]);
/// # Ok::<(), forelock_neural::codes::LocksError>(())
/// ```
pub fn static_inputs(uv: &[[f64; 2]], codes: &[f32], deviation: f32) -> Result<Vec<f32>, LocksError> {
    let locks = Locks::new(uv, LOCK_SIZE)?;
    let width = codes.len() / uv.len();
    let means = locks.mean_codes(codes, width)?;
    let mut inputs = Vec::with_capacity(uv.len() * (2 + 2 * width));
    for ((uv, code), lock) in uv.iter().zip(codes.chunks_exact(width)).zip(locks.labels()) {
        let mean = &means[*lock as usize * width..][..width];
        inputs.extend(uv.map(|x| x as f32));
        inputs.extend(code.iter().chain(mean).map(|x| x / deviation));
    }
    Ok(inputs)
}
