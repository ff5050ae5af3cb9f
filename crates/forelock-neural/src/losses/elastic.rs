//! Stretch, and bending and twist of a Cosserat rod whose frames are carried along the strand.
//!
//! # Theory
//! With edges e_i = x_{i+1} − x_i of length l_i and direction t_i:
//!
//! ```text
//! stretch     k_s/2 Σ (l_i − l⁰_i)²
//! bend–twist  Σ_k (2 k_bt/L_k) |s Im p_k − Im p⁰_k|²,   p_k = q̄_k q_{k+1}
//!             s = −1 if p_k · p⁰_k < 0 (all four components), otherwise 1
//!             L_0 = l⁰_0/2,  L_k = (l⁰_{k−1} + l⁰_k)/2
//! sequential  q_0 = 1,  q_{i+1} = arc(t_{i−1}, t_i) q_i,  t_{−1} = t⁰_0
//! direct      q_0 = arc(a, t⁰_0),  q_{i+1} = arc(a, t_i)
//! arc(a, b) = (n/2, a × b/n),  n = max(√(2 (1 + a·b)), n_min)
//! ```
//!
//! The bar on q_k and the sign s are missing in the paper's Eq. 3. Direct transport, which the
//! paper uses, is right for straight hair only: the twist between two frames then depends on
//! a.
//!
//! # Practice
//! The gradient is the adjoint of the products: for z = x y, x receives z̄ conj(y) and y receives
//! conj(x) z̄.

#![expect(clippy::needless_range_loop, reason = "loops with one index for several arrays vectorise")]

use super::Strand;
use crate::EDGES;
use forelock_core::lane::{Lane, Quat, V3};

/// The least n of an arc in training: it bounds gradients where an edge folds back.
pub const LEAST_ARC: f64 = 0.05;
/// The least squared length of an edge, cm²: a coincident pair of particles has no direction.
const LEAST_SQUARE: f64 = 1e-20;

/// How frames are carried along a strand.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Transport {
    /// From each edge to the next.
    #[default]
    Sequential,
    /// From a, the root's direction at rest, to each edge: the paper's.
    Direct,
    /// From a, the direction from root to tip at rest, to each edge.
    Chord,
}

/// Stiffnesses and options of [`elastic`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElasticTerms {
    /// k_s, g s⁻².
    pub stretch: f64,
    /// k_bt, g cm³ s⁻².
    pub bend_twist: f64,
    /// How frames are carried.
    pub transport: Transport,
    /// The least n of an arc.
    pub least_arc: f64,
    /// Whether the first edge is held in its direction at rest (the pair k = 0).
    pub clamps_root: bool,
}

impl Default for ElasticTerms {
    fn default() -> Self {
        Self {
            stretch: 200.0,
            bend_twist: 100.0,
            transport: Transport::default(),
            least_arc: LEAST_ARC,
            clamps_root: true,
        }
    }
}

/// What the elastic energies know of a strand at rest.
#[derive(Clone, Copy, Debug)]
pub struct RestStrand<L> {
    /// l⁰_i, cm.
    pub lengths: [L; EDGES],
    /// t⁰_0.
    pub root_direction: V3<L>,
    /// Where the first arc starts: t⁰_0, or the direction from root to tip.
    pub axis: V3<L>,
    /// p⁰_k.
    pub pairs: [Quat<L>; EDGES],
    /// 2/L_k, cm⁻¹.
    pub inverse_spans: [L; EDGES],
}

impl<L: Lane> RestStrand<L> {
    /// The strand at rest at `x`, cm.
    #[inline(always)]
    pub fn new(x: &Strand<L>, terms: &ElasticTerms) -> Self {
        let edges = Edges::new(x);
        let chord = x[EDGES] - x[0];
        let over_chord = L::one() / chord.dot(chord).max(L::from_f64(LEAST_SQUARE)).sqrt();
        let is_chord = terms.transport == Transport::Chord;
        let mut rest = Self {
            lengths: edges.lengths,
            root_direction: edges.directions[0],
            axis: if is_chord { chord.scale(over_chord) } else { edges.directions[0] },
            pairs: [Quat::zero(); EDGES],
            inverse_spans: [L::zero(); EDGES],
        };
        let frames = Frames::new(&rest, &edges, terms);
        for k in 0..EDGES {
            rest.pairs[k] = frames.pair(k);
            let span = if k == 0 { edges.lengths[0] } else { edges.lengths[k - 1] + edges.lengths[k] };
            rest.inverse_spans[k] = L::from_f64(4.0) / span;
        }
        rest
    }
}

/// Lengths and directions of edges.
struct Edges<L> {
    lengths: [L; EDGES],
    directions: [V3<L>; EDGES],
}

impl<L: Lane> Edges<L> {
    #[inline(always)]
    fn new(x: &Strand<L>) -> Self {
        let mut edges = Self { lengths: [L::zero(); EDGES], directions: [V3::zero(); EDGES] };
        for i in 0..EDGES {
            let edge = x[i + 1] - x[i];
            edges.lengths[i] = edge.dot(edge).max(L::from_f64(LEAST_SQUARE)).sqrt();
            edges.directions[i] = edge.scale(L::one() / edges.lengths[i]);
        }
        edges
    }
}

/// The frames q_0 … q_E of a strand.
struct Frames<L> {
    transport: Transport,
    least_arc: L,
    axis: V3<L>,
    frames: [Quat<L>; EDGES + 1],
    arcs: [Quat<L>; EDGES],
}

impl<L: Lane> Frames<L> {
    #[inline(always)]
    fn new(rest: &RestStrand<L>, edges: &Edges<L>, terms: &ElasticTerms) -> Self {
        let least_arc = L::from_f64(terms.least_arc.max(1e-9));
        let one = Quat { v: V3::zero(), w: L::one() };
        let mut own = Self {
            transport: terms.transport,
            least_arc,
            axis: rest.axis,
            frames: [one; EDGES + 1],
            arcs: [one; EDGES],
        };
        if terms.transport != Transport::Sequential {
            own.frames[0] = arc(rest.axis, rest.root_direction, least_arc);
        }
        for i in 0..EDGES {
            own.arcs[i] = arc(own.from(edges, i), edges.directions[i], least_arc);
            own.frames[i + 1] = match terms.transport {
                Transport::Sequential => own.arcs[i] * own.frames[i],
                Transport::Direct | Transport::Chord => own.arcs[i],
            };
        }
        own
    }

    /// Where the arc to edge `i` starts.
    #[inline(always)]
    fn from(&self, edges: &Edges<L>, i: usize) -> V3<L> {
        match self.transport {
            Transport::Sequential if i > 0 => edges.directions[i - 1],
            _ => self.axis,
        }
    }

    /// p_k.
    #[inline(always)]
    fn pair(&self, k: usize) -> Quat<L> {
        self.frames[k].conjugate() * self.frames[k + 1]
    }

    /// Adds to `directions` the gradient of a function whose gradient with respect to p_k is
    /// `pairs[k]`.
    #[inline(always)]
    fn gradient(&self, edges: &Edges<L>, pairs: &[Quat<L>; EDGES], directions: &mut [V3<L>; EDGES]) {
        // With respect to q_{k+1}, from the pairs after k.
        let mut later = Quat::zero();
        for k in (0..EDGES).rev() {
            let frame = later + self.frames[k] * pairs[k];
            later = self.frames[k + 1] * pairs[k].conjugate();
            let turn = match self.transport {
                Transport::Sequential => {
                    later = later + self.arcs[k].conjugate() * frame;
                    frame * self.frames[k].conjugate()
                }
                Transport::Direct | Transport::Chord => frame,
            };
            let ends = [self.from(edges, k), edges.directions[k]];
            let [from, to] = arc_gradient(ends, self.least_arc, turn);
            directions[k] += to;
            if self.transport == Transport::Sequential && k > 0 {
                directions[k - 1] += from;
            }
        }
    }
}

/// The shortest rotation from `a` to `b`, unit vectors, as a quaternion of length 1 where n is at
/// least `least`.
#[inline(always)]
fn arc<L: Lane>(a: V3<L>, b: V3<L>, least: L) -> Quat<L> {
    let n = root(a.dot(b)).max(least);
    Quat { v: a.cross(b).scale(L::one() / n), w: n * L::from_f64(0.5) }
}

/// √(2 (1 + cosine)).
#[inline(always)]
fn root<L: Lane>(cosine: L) -> L {
    let two = L::from_f64(2.0);
    two.mul_add(cosine, two).max(L::zero()).sqrt()
}

/// The gradient with respect to both ends of an arc, from that with respect to its quaternion.
#[inline(always)]
fn arc_gradient<L: Lane>([a, b]: [V3<L>; 2], least: L, turn: Quat<L>) -> [V3<L>; 2] {
    let free = root(a.dot(b));
    let inverse = L::one() / free.max(least);
    let axis = a.cross(b);
    let by_axis = turn.v.scale(inverse);
    let by_n = turn.w * L::from_f64(0.5) - by_axis.dot(axis) * inverse;
    let by_cosine = L::select(free.lt(least), L::zero(), by_n * inverse);
    [b.cross(by_axis).add_scaled(by_cosine, b), by_axis.cross(a).add_scaled(by_cosine, a)]
}

/// Stretch and bend–twist.
#[inline(always)]
pub fn elastic<L: Lane>(
    terms: &ElasticTerms,
    rest: &RestStrand<L>,
    x: &Strand<L>,
    gradient: &mut Strand<L>,
) -> L {
    let edges = Edges::new(x);
    let (mut energy, k_s) = (L::zero(), L::from_f64(terms.stretch));
    let mut by_length = [L::zero(); EDGES];
    for i in 0..EDGES {
        let excess = edges.lengths[i] - rest.lengths[i];
        by_length[i] = k_s * excess;
        energy += by_length[i] * excess * L::from_f64(0.5);
    }
    let frames = Frames::new(rest, &edges, terms);
    let k_bt = L::from_f64(terms.bend_twist);
    let mut pairs = [Quat::zero(); EDGES];
    for k in usize::from(!terms.clamps_root)..EDGES {
        let (pair, at_rest) = (frames.pair(k), rest.pairs[k]);
        let sign = L::select(pair.dot(at_rest).lt(L::zero()), -L::one(), L::one());
        let strain = pair.v.scale(sign) - at_rest.v;
        let stiffness = k_bt * rest.inverse_spans[k];
        energy += stiffness * strain.dot(strain);
        pairs[k] = Quat::pure(strain.scale(stiffness * sign * L::from_f64(2.0)));
    }
    let mut directions = [V3::zero(); EDGES];
    frames.gradient(&edges, &pairs, &mut directions);
    for i in 0..EDGES {
        let t = edges.directions[i];
        let across = (directions[i] - t.scale(t.dot(directions[i]))).scale(L::one() / edges.lengths[i]);
        let by_edge = across.add_scaled(by_length[i], t);
        gradient[i + 1] += by_edge;
        gradient[i] -= by_edge;
    }
    energy
}
