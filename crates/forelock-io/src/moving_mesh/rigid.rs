//! The rigid motion that fits best between two sets of vertices.

use glam::{DMat3, DQuat, DVec3, Vec3};

/// Maximum number of turns that lead from one rotation to the next.
const TURNS: u32 = 64;

/// A rotation, and where the centroid is.
pub(super) type Placement = (DQuat, DVec3);

/// The centroid of `own`.
pub(super) fn middle(own: &[Vec3]) -> DVec3 {
    own.iter().map(|p| p.as_dvec3()).sum::<DVec3>() / own.len() as f64
}

/// The rigid motion that takes the vertices `first`, whose centroid is `from`, nearest to `own`,
/// found from the rotation `turn`.
pub(super) fn fit(first: &[Vec3], from: DVec3, own: &[Vec3], turn: DQuat) -> Placement {
    if own == first {
        return (DQuat::IDENTITY, from);
    }
    let to = middle(own);
    let mut product = DMat3::ZERO;
    for (a, b) in own.iter().zip(first) {
        let (a, b) = (a.as_dvec3() - to, b.as_dvec3() - from);
        product += DMat3::from_cols(a * b.x, a * b.y, a * b.z);
    }
    (rotation_of(&product, turn), to)
}

/// What the rigid motion `now` of the vertices `from`, whose joint is at `middle` at first, lacks
/// to `to`, in the space of `from`.
pub(super) fn remainders<'a>(
    from: &'a [Vec3],
    to: &'a [Vec3],
    middle: DVec3,
    now: &Placement,
) -> impl Iterator<Item = Vec3> + 'a {
    let (back, shift) = (DMat3::from_quat(now.0.inverse()), now.1);
    let lacks = move |from: &Vec3, to: &Vec3| back * (to.as_dvec3() - shift) - (from.as_dvec3() - middle);
    from.iter().zip(to).map(move |(from, to)| lacks(from, to).as_vec3())
}

/// The rotation nearest to `product`, found from `turn`.
fn rotation_of(product: &DMat3, mut turn: DQuat) -> DQuat {
    for _ in 0..TURNS {
        let own = DMat3::from_quat(turn);
        let axes = [(own.x_axis, product.x_axis), (own.y_axis, product.y_axis), (own.z_axis, product.z_axis)];
        let along: f64 = axes.iter().map(|(a, b)| a.dot(*b)).sum();
        let by = axes.iter().map(|(a, b)| a.cross(*b)).sum::<DVec3>() / (along.abs() + f64::MIN_POSITIVE);
        let angle = by.length();
        if angle <= 1e-14 || angle.is_nan() {
            break;
        }
        turn = (DQuat::from_axis_angle(by / angle, angle) * turn).normalize();
    }
    turn
}
