//! The network that predicts a strand from its code and the body's pose history (Neuralocks, Sec.
//! 4.3).
//!
//! # Theory
//! Three layers with ReLU between them. The inputs of the first one come in two parts: `statics`
//! (the root's uv, the strand's code, its lock's code) belong to a strand, `shared` (pose, body
//! shape, history) to a frame:
//!
//! ```text
//! h = relu(Sᵀ statics + b₁ + Fᵀ shared),   g = relu(Hᵀ h + b₂),   o = Oᵀ g + b₃
//! ```
//!
//! So Sᵀ statics + b₁ is computed once a groom and Fᵀ shared once a frame. What is left for a
//! strand and a frame are 168,192 floating-point operations instead of 550,912.
//!
//! # Practice
//! [`evaluate`] is the specification. [`inference`] runs packets of 64 strands through one
//! matrix product ([`product`]); [`packed`] does so for the strands of a simulation, which have any
//! number of particles.

pub mod head;
pub mod inference;
pub mod packed;
pub mod product;
pub mod rotation;

use forelock_core::lane::Real;
use std::ops::Range;

/// Inputs of a strand: uv, its code, its lock's code.
pub const STATICS: usize = 2 + 32 + 32;
/// Those of them that are its lock's code.
pub const LOCK_INPUTS: Range<usize> = 2 + 32..STATICS;
/// Inputs of a frame: pose, body shape, history.
pub const SHARED: usize = 24 + 10 + 27 * 24;
/// Hidden units of both layers.
pub const WIDTH: usize = 256;
/// Outputs: three numbers an edge.
pub const OUTPUTS: usize = 3 * crate::EDGES;

/// Sizes of a network's layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Inputs of a strand.
    pub statics: usize,
    /// Inputs of a frame.
    pub shared: usize,
    /// Units of each hidden layer.
    pub width: usize,
    /// Outputs.
    pub outputs: usize,
}

impl Default for Shape {
    fn default() -> Self {
        Self { statics: STATICS, shared: SHARED, width: WIDTH, outputs: OUTPUTS }
    }
}

impl Shape {
    /// Where each part is in the list of all parameters. Matrices are row-major, `[inputs,
    /// outputs]`: statics, shared, first bias, hidden, second bias, output, third bias.
    pub fn ranges(&self) -> [Range<usize>; 7] {
        let Self { statics, shared, width, outputs } = *self;
        let sizes = [statics * width, shared * width, width, width * width, width, width * outputs, outputs];
        let mut end = 0;
        sizes.map(|size| {
            end += size;
            end - size..end
        })
    }

    /// The number of parameters.
    pub fn parameters(&self) -> usize {
        self.ranges()[6].end
    }

    /// The deviations of the first and the second layer's weights at the start of a training:
    /// √(2/inputs).
    pub(crate) fn deviations(&self) -> [f64; 2] {
        [self.statics + self.shared, self.width].map(|inputs| (2.0 / inputs as f64).sqrt())
    }

    /// Floating-point operations of a strand and a frame: two products and the sum of both parts of
    /// the first layer.
    pub fn operations_per_strand(&self) -> usize {
        2 * self.width * (self.width + self.outputs) + self.width
    }

    /// Floating-point operations of a frame, whatever the number of strands.
    pub fn operations_per_frame(&self) -> usize {
        2 * self.shared * self.width
    }
}

/// A network.
#[derive(Clone, Debug, PartialEq)]
pub struct Network<T> {
    shape: Shape,
    parameters: Vec<T>,
}

/// A list of parameters whose length is not that of the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a network of this shape has {expected} parameters, not {found}")]
pub struct LengthError {
    /// The number that the shape needs.
    pub expected: usize,
    /// The number given.
    pub found: usize,
}

impl<T: Real> Network<T> {
    /// A network with the given parameters, in the order of [`Shape::ranges`].
    ///
    /// # Errors
    /// If their number is not that of the shape.
    pub fn new(shape: Shape, parameters: Vec<T>) -> Result<Self, LengthError> {
        let (expected, found) = (shape.parameters(), parameters.len());
        if expected == found { Ok(Self { shape, parameters }) } else { Err(LengthError { expected, found }) }
    }

    /// A network whose parameters are known to have the right number.
    pub(crate) fn of(shape: Shape, parameters: Vec<T>) -> Self {
        Self { shape, parameters }
    }

    /// The sizes of its layers.
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// All parameters.
    pub fn parameters(&self) -> &[T] {
        &self.parameters
    }

    /// All parameters, to be changed.
    pub fn parameters_mut(&mut self) -> &mut [T] {
        &mut self.parameters
    }

    /// The seven parts, in the order of [`Shape::ranges`].
    pub fn parts(&self) -> [&[T]; 7] {
        self.shape.ranges().map(|range| &self.parameters[range])
    }
}

/// Σ_i `inputs[i]` `matrix[i, ·]` added to `sums`: a layer of one strand.
pub(crate) fn add_layer<T: Real>(matrix: &[T], inputs: &[T], sums: &mut [T]) {
    for (row, x) in matrix.chunks_exact(sums.len()).zip(inputs) {
        for (sum, weight) in sums.iter_mut().zip(row) {
            *sum = *sum + *weight * *x;
        }
    }
}

/// The first layer's sums of a strand: Sᵀ statics + b₁, `[width]`.
pub fn static_part<T: Real>(network: &Network<T>, statics: &[T]) -> Vec<T> {
    let [matrix, _, bias, ..] = network.parts();
    let mut sums = bias.to_vec();
    add_layer(matrix, statics, &mut sums);
    sums
}

/// The first layer's sums of a frame: Fᵀ shared, `[width]`.
pub fn shared_part<T: Real>(network: &Network<T>, shared: &[T]) -> Vec<T> {
    let mut sums = vec![T::zero(); network.shape.width];
    add_layer(network.parts()[1], shared, &mut sums);
    sums
}

/// The outputs of a strand, `[outputs]`, from both parts of the first layer.
pub fn evaluate<T: Real>(network: &Network<T>, static_part: &[T], shared_part: &[T]) -> Vec<T> {
    let [.., hidden, second_bias, output, third_bias] = network.parts();
    let relu = |sum: T| sum.max(T::zero());
    let h: Vec<T> = static_part.iter().zip(shared_part).map(|(a, b)| relu(*a + *b)).collect();
    let mut g = second_bias.to_vec();
    add_layer(hidden, &h, &mut g);
    let g: Vec<T> = g.into_iter().map(relu).collect();
    let mut o = third_bias.to_vec();
    add_layer(output, &g, &mut o);
    o
}
