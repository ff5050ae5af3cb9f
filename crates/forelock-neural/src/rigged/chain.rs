//! Chains of joints: positions, distances, energy and its gradient.

use super::pose::RigPose;
use super::vec3::{Exponential, M, V, add, apply, apply_transposed, cross, dot, finite, num, scale, sub};
use super::{ANGLES, CHAINS, JOINTS, RigError};
use forelock_core::lane::Real;

/// Angles of a rig: the rotation vectors of the joints in radians, chain by chain from the root.
pub type Angles<T> = [T; ANGLES];
/// Positions of the ends of the bones in cm, in the head's axes: shape \[chains, joints\].
pub type Ends<T> = [[[T; 3]; JOINTS]; CHAINS];

/// A chain of bones at rest, in the axes of the head.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chain<T> {
    /// Position of the first joint, in cm.
    pub root: [T; 3],
    /// The bone of each joint, in cm.
    pub bones: [[T; 3]; JOINTS],
    /// Radius r of the hair around the chain, in cm.
    pub radius: T,
}

/// A capsule: the points within `radius` of the segment from `a` to `b`, in cm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Capsule<T> {
    /// One end of the axis.
    pub a: [T; 3],
    /// The other end.
    pub b: [T; 3],
    /// The radius.
    pub radius: T,
}

/// Neck and shoulders, in the axes of the torso, in cm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Torso<T> {
    /// Where the head turns on the neck, in the axes of the **head**.
    pub pivot: [T; 3],
    /// From there to the middle of the shoulders.
    pub neck: [T; 3],
    /// From the middle of the shoulders to one of them; the other lies opposite.
    pub shoulder: [T; 3],
    /// Radius of the neck.
    pub neck_radius: T,
    /// Radius of the shoulders.
    pub shoulder_radius: T,
}

/// What acts on the chains in one pose, in the axes of the head.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body<T> {
    /// The direction of gravity, a unit vector.
    pub gravity: [T; 3],
    /// Shoulders and neck.
    pub capsules: [Capsule<T>; 2],
}

/// The weights of the energy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigWeights<T> {
    /// m, the mass of each joint's end: 1e-3 g by default.
    pub mass: T,
    /// g, the acceleration of gravity: 981 cm/s² by default.
    pub gravity: T,
    /// k_b, the stiffness of the joints: 60 by default; 0 lets them hang.
    pub k_b: T,
    /// k_c, the stiffness of contact: 100 by default; 0 takes the body away.
    pub k_c: T,
    /// D, the distance at which contact begins: 0.3 cm by default.
    pub distance: T,
}

impl<T: Real> Default for RigWeights<T> {
    fn default() -> Self {
        Self { mass: num(1e-3), gravity: num(981.0), k_b: num(60.0), k_c: num(100.0), distance: num(0.3) }
    }
}

/// A rig of hair on a head.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rig<T> {
    chains: [Chain<T>; CHAINS],
    half_axes: [T; 3],
    torso: Torso<T>,
    weights: RigWeights<T>,
}

impl<T: Real> Rig<T> {
    /// A rig of `chains` on a head that is an ellipsoid of `half_axes` (cm) about the origin.
    ///
    /// # Errors
    /// If a number is not finite, or a radius or half axis not positive.
    pub fn new(
        chains: [Chain<T>; CHAINS],
        half_axes: [T; 3],
        torso: Torso<T>,
        weights: RigWeights<T>,
    ) -> Result<Self, RigError> {
        let positive = |x: T| x > T::zero() && x.is_finite();
        let is =
            |condition: bool, what: &'static str| if condition { Ok(()) } else { Err(RigError::Rig(what)) };
        for chain in &chains {
            let lengths = finite(chain.root) && chain.bones.into_iter().all(finite);
            is(lengths && positive(chain.radius), "chains")?;
        }
        is(half_axes.into_iter().all(positive), "head")?;
        let lengths = finite(torso.pivot) && finite(torso.neck) && finite(torso.shoulder);
        is(lengths && positive(torso.neck_radius) && positive(torso.shoulder_radius), "torso")?;
        let RigWeights { mass, gravity, k_b, k_c, distance } = weights;
        is([mass, gravity, k_b, k_c, distance].into_iter().all(T::is_finite), "weights")?;
        Ok(Self { chains, half_axes, torso, weights })
    }

    /// A ponytail, two strands of the sides and a fringe on an adult's head.
    pub fn example() -> Self {
        let vector = |v: [f64; 3]| v.map(num);
        let chain = |root, bones: [[f64; 3]; JOINTS], radius| Chain {
            root: vector(root),
            bones: bones.map(vector),
            radius: num(radius),
        };
        let (tail, fringe) = ([0.0, -5.935, -0.89], [0.7, -1.2, 1.44]);
        let chains = [
            chain([0.0, 4.0, -9.6], [[0.0, -1.982, -5.663], tail, tail, tail, tail], 1.6),
            chain([-7.6, 0.0, -2.0], [[-1.981, -3.962, -0.792]; JOINTS], 1.2),
            chain([7.6, 0.0, -2.0], [[1.981, -3.962, -0.792]; JOINTS], 1.2),
            chain([0.0, 9.6, 5.0], [[0.0, 0.575, 1.916], fringe, fringe, fringe, fringe], 0.6),
        ];
        let torso = Torso {
            pivot: vector([0.0, -9.0, -2.0]),
            neck: vector([0.0, -13.0, 0.0]),
            shoulder: vector([15.0, 0.0, 0.0]),
            neck_radius: num(5.5),
            shoulder_radius: num(7.0),
        };
        Self { chains, half_axes: vector([7.5, 10.5, 9.0]), torso, weights: RigWeights::default() }
    }

    /// Gravity and the capsules in a pose.
    pub fn body(&self, pose: &RigPose<T>) -> Body<T> {
        let head_from_torso = pose.head_from_torso();
        let torso = &self.torso;
        let middle = add(torso.pivot, apply(&head_from_torso, torso.neck));
        let shoulder = apply(&head_from_torso, torso.shoulder);
        Body {
            gravity: pose.gravity,
            capsules: [
                Capsule { a: sub(middle, shoulder), b: add(middle, shoulder), radius: torso.shoulder_radius },
                Capsule { a: middle, b: torso.pivot, radius: torso.neck_radius },
            ],
        }
    }

    /// The ends of the bones: x_{j+1} = x_j + R_j b_j, R_j = R_{j−1} exp(θ_j), R₋₁ = 1.
    pub fn joints(&self, angles: &Angles<T>) -> Ends<T> {
        std::array::from_fn(|c| self.chains[c].pose(chain_angles(angles, c)).ends())
    }

    /// The distance of the ends of the bones to head, neck and shoulders, less the chain's radius,
    /// in cm: shape \[chains, joints\]. Negative inside.
    pub fn distances(&self, body: &Body<T>, ends: &Ends<T>) -> [[T; JOINTS]; CHAINS] {
        std::array::from_fn(|c| ends[c].map(|x| self.distance(body, x).0 - self.chains[c].radius))
    }

    /// The energy E in g·cm²/s², and its gradient with respect to the angles in `gradient`.
    pub fn energy(&self, body: &Body<T>, angles: &Angles<T>, gradient: &mut Angles<T>) -> T {
        let RigWeights { mass, gravity, k_b, k_c, distance } = self.weights;
        let weight = scale(body.gravity, mass * gravity);
        let mut energy = num::<T>(0.05) * k_b * angles.iter().fold(T::zero(), |s, &t| s + t * t);
        for (c, chain) in self.chains.iter().enumerate() {
            let pose = chain.pose(chain_angles(angles, c));
            // The force's opposite at each end.
            let mut pulls = [[T::zero(); 3]; JOINTS];
            for (pull, x) in pulls.iter_mut().zip(pose.ends()) {
                energy = energy - dot(weight, x);
                *pull = scale(weight, -T::one());
                let (d, normal) = self.distance(body, x);
                let depth = distance - d + chain.radius;
                if depth > T::zero() {
                    energy = energy + k_c * depth * depth * depth;
                    *pull = sub(*pull, scale(normal, num::<T>(3.0) * k_c * depth * depth));
                }
            }
            pose.gradient(&pulls, &mut gradient[c * 3 * JOINTS..][..3 * JOINTS]);
        }
        for (slope, &angle) in gradient.iter_mut().zip(angles) {
            *slope = *slope + num::<T>(0.1) * k_b * angle;
        }
        energy
    }

    /// The least distance of a point to the solids, and its gradient.
    fn distance(&self, body: &Body<T>, x: V<T>) -> (T, V<T>) {
        let mut least = ellipsoid(self.half_axes, x);
        for capsule in &body.capsules {
            let found = capsule.distance(x);
            if found.0 < least.0 {
                least = found;
            }
        }
        least
    }
}

impl<T: Real> Capsule<T> {
    /// The distance of a point to the surface, and its gradient.
    fn distance(&self, x: V<T>) -> (T, V<T>) {
        let (axis, from_a) = (sub(self.b, self.a), sub(x, self.a));
        let square = dot(axis, axis);
        let along = if square > T::zero() { dot(from_a, axis) / square } else { T::zero() };
        let offset = sub(from_a, scale(axis, along.max(T::zero()).min(T::one())));
        let length = dot(offset, offset).sqrt();
        let normal = if length > T::zero() { scale(offset, T::one() / length) } else { offset };
        (length - self.radius, normal)
    }
}

/// The distance d = k₀(k₀ − 1)/k₁ with k₀ = |x/r|, k₁ = |x/r²|, componentwise, and its gradient:
/// exact on the surface and its normal, a bound elsewhere.
fn ellipsoid<T: Real>(half_axes: V<T>, x: V<T>) -> (T, V<T>) {
    let over = |v: V<T>| [v[0] / half_axes[0], v[1] / half_axes[1], v[2] / half_axes[2]];
    let once = over(x);
    let twice = over(once);
    let k0 = dot(once, once).sqrt();
    let k1 = dot(twice, twice).sqrt();
    if k1 <= T::zero() {
        let least = half_axes[0].min(half_axes[1]).min(half_axes[2]);
        return (-least, [T::zero(); 3]);
    }
    let d = k0 * (k0 - T::one()) / k1;
    // ∇k₀ = x/r²/k₀, ∇k₁ = x/r⁴/k₁.
    let by_k0 = (k0 + k0 - T::one()) / (k0 * k1);
    let by_k1 = d / (k1 * k1);
    (d, sub(scale(twice, by_k0), scale(over(over(twice)), by_k1)))
}

fn chain_angles<T: Real>(angles: &Angles<T>, chain: usize) -> &[[T; 3]] {
    &angles.as_chunks::<3>().0[chain * JOINTS..][..JOINTS]
}

/// A chain turned by its angles.
struct ChainPose<T> {
    turns: [Exponential<T>; JOINTS],
    rotations: [M<T>; JOINTS],
    /// The first joint, then the ends of the bones.
    positions: [V<T>; JOINTS + 1],
}

impl<T: Real> Chain<T> {
    fn pose(&self, angles: &[[T; 3]]) -> ChainPose<T> {
        let (zero, one) = (T::zero(), T::one());
        let turns: [_; JOINTS] = std::array::from_fn(|j| Exponential::new(angles[j]));
        let mut rotation = [[one, zero, zero], [zero, one, zero], [zero, zero, one]];
        let mut rotations = [rotation; JOINTS];
        let mut positions = [self.root; JOINTS + 1];
        for j in 0..JOINTS {
            // The columns of R_{j−1} exp(θ_j).
            let turned = |column: V<T>| apply(&rotation, turns[j].rotate(column));
            rotation = [turned([one, zero, zero]), turned([zero, one, zero]), turned([zero, zero, one])];
            rotations[j] = rotation;
            positions[j + 1] = add(positions[j], apply(&rotation, self.bones[j]));
        }
        ChainPose { turns, rotations, positions }
    }
}

impl<T: Real> ChainPose<T> {
    fn ends(&self) -> [V<T>; JOINTS] {
        std::array::from_fn(|j| self.positions[j + 1])
    }

    /// The gradient with respect to the angles from that with respect to the ends: from the tip to
    /// the root, τ_j = τ_{j+1} + (x_{j+1} − x_j) × Σ_{i>j} ∂E/∂x_i.
    fn gradient(&self, pulls: &[V<T>; JOINTS], gradient: &mut [T]) {
        let (mut pull, mut torque) = ([T::zero(); 3], [T::zero(); 3]);
        for j in (0..JOINTS).rev() {
            pull = add(pull, pulls[j]);
            torque = add(torque, cross(sub(self.positions[j + 1], self.positions[j]), pull));
            let local = apply_transposed(&self.rotations[j], torque);
            gradient[3 * j..][..3].copy_from_slice(&self.turns[j].right_jacobian_transposed(local));
        }
    }
}
