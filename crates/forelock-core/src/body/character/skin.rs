//! Skinning: vertices that follow several joints.
//!
//! # Theory
//! Bone b, a joint with the inverse of its pose when the mesh was bound, moves space by M_b = G_b
//! B_b⁻¹. Linear blend skinning moves a vertex by the weighted mean of the matrices,
//!
//! ```text
//! x = Σ_b w_b M_b v
//! ```
//!
//! as glTF 2.0 (section 3.7.3) does. Its mean of rotations shrinks the mesh where joints twist.
//! Dual quaternion skinning (Kavan et al. 2007) blends rigid motions instead: with M_b = D_b A_b,
//! D_b rigid and A_b the stretch that remains, x = (Σ w_b D_b / |Σ w_b D_b|) Σ w_b A_b v, where the
//! signs of the D_b are those nearest to the sum so far, that of the largest weight first.

use glam::{DAffine3, DMat3, DQuat, Quat, Vec3, Vec4};
use rayon::prelude::*;

use super::skeleton::nearest_rotation;

/// The same as [`Skin::deform`] on a GPU.
pub const SKIN_WGSL: &str = include_str!("skin.wgsl");
/// The most bones that a vertex follows.
pub const MAX_INFLUENCES: usize = 8;

/// Vertices that a thread moves at a time.
const CHUNK: usize = 1024;

/// How the motions of bones are blended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum Skinning {
    /// The mean of their matrices.
    #[default]
    Linear,
    /// The mean of their dual quaternions: limbs that twist keep their girth.
    DualQuaternion,
}

impl Skinning {
    /// Vectors of four numbers that the kernels read of a bone: see [`Palette::pack`].
    pub const fn bone_vectors(self) -> usize {
        match self {
            Self::Linear => 3,
            Self::DualQuaternion => 5,
        }
    }
}

/// A joint that vertices follow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bone {
    /// The joint.
    pub joint: usize,
    /// From the mesh's space to the joint's, when the mesh was bound.
    pub inverse_bind: DAffine3,
}

/// Which bones each vertex follows, and how much.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Skin {
    bones: Vec<Bone>,
    /// Bones a vertex.
    influences: usize,
    /// `[V, influences]`, the largest weight first.
    indices: Vec<u16>,
    /// `[V, influences]`; they sum up to 1.
    weights: Vec<f32>,
}

/// What was changed to make weights usable.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SkinReport {
    /// Vertices that follow more than [`MAX_INFLUENCES`] bones; the smallest weights are dropped.
    pub reduced: usize,
    /// Vertices whose weights did not sum up to 1; they are scaled.
    pub rescaled: usize,
    /// Vertices without a valid weight; they follow bone 0.
    pub unbound: usize,
}

impl SkinReport {
    /// One sentence for each kind of change.
    pub fn sentences(&self) -> Vec<String> {
        let mut sentences = Vec::new();
        if self.reduced > 0 {
            let (count, most) = (self.reduced, MAX_INFLUENCES);
            sentences
                .push(format!("{count} vertices follow more than {most} joints: the least were dropped"));
        }
        if self.rescaled > 0 {
            sentences.push(format!("the weights of {} vertices did not sum up to 1: scaled", self.rescaled));
        }
        if self.unbound > 0 {
            let count = self.unbound;
            sentences.push(format!("{count} vertices have no valid weight: they follow the first joint"));
        }
        sentences
    }
}

/// Sum of weights that counts as 1, for weights stored in 8 bits too.
const SUM_TOLERANCE: f32 = 0.01;

impl Skin {
    /// The skin of `bones` (at most 65,536) and of the bones and weights of each vertex, both
    /// repaired: weights below zero, not finite, or of bones that are not there are dropped.
    pub fn new(bones: Vec<Bone>, mut vertices: Vec<Vec<(usize, f32)>>) -> (Self, SkinReport) {
        let mut report = SkinReport::default();
        for own in &mut vertices {
            own.retain(|&(bone, weight)| weight.is_finite() && weight > 0.0 && bone < bones.len());
            own.sort_by_key(|own| own.0);
            own.dedup_by(|next, kept| {
                let same = next.0 == kept.0;
                kept.1 += if same { next.1 } else { 0.0 };
                same
            });
            own.sort_by(|a, b| b.1.total_cmp(&a.1));
            report.reduced += usize::from(own.len() > MAX_INFLUENCES);
            let sum: f32 = own.iter().map(|own| own.1).sum();
            own.truncate(MAX_INFLUENCES);
            if own.is_empty() {
                report.unbound += 1;
                own.push((0, 1.0));
                continue;
            }
            report.rescaled += usize::from((sum - 1.0).abs() > SUM_TOLERANCE);
            let kept: f32 = own.iter().map(|own| own.1).sum();
            if kept != 1.0 {
                own.iter_mut().for_each(|own| own.1 /= kept);
            }
        }
        let influences = vertices.iter().map(Vec::len).max().unwrap_or(1).max(1);
        let mut skin = Self { bones, influences, indices: Vec::new(), weights: Vec::new() };
        for own in &vertices {
            for i in 0..influences {
                let (bone, weight) = own.get(i).copied().unwrap_or((own[0].0, 0.0));
                skin.indices.push(u16::try_from(bone).unwrap_or(0));
                skin.weights.push(weight);
            }
        }
        (skin, report)
    }

    /// The bones.
    pub fn bones(&self) -> &[Bone] {
        &self.bones
    }

    /// Bones a vertex: the length of [`Skin::of_vertex`].
    pub fn influences(&self) -> usize {
        self.influences
    }

    /// Number of vertices.
    pub fn vertices(&self) -> usize {
        self.indices.len() / self.influences.max(1)
    }

    /// Bones and weights of a vertex; unused ones have weight 0.
    ///
    /// # Panics
    /// If `vertex` is out of range.
    pub fn of_vertex(&self, vertex: usize) -> impl Iterator<Item = (usize, f32)> {
        let range = vertex * self.influences..(vertex + 1) * self.influences;
        self.indices[range.clone()].iter().map(|&i| i.into()).zip(self.weights[range].iter().copied())
    }

    /// Applies `map` to the space of the mesh that is bound.
    pub(super) fn transform(&mut self, map: &DAffine3) {
        let back = map.inverse();
        self.bones.iter_mut().for_each(|bone| bone.inverse_bind *= back);
    }

    /// The bones' motions M_b of joints whose transforms to the body's space are `globals`.
    pub fn palette(&self, globals: &[DAffine3], palette: &mut Palette) {
        palette.matrices.clear();
        palette.matrices.extend(self.bones.iter().map(|bone| globals[bone.joint] * bone.inverse_bind));
    }

    /// Moves `vertices` by `palette` and writes the places to `out`.
    ///
    /// # Panics
    /// If `vertices` are more than the skin's, or `palette` is of another skin.
    pub fn deform(&self, vertices: &[Vec3], palette: &Palette, skinning: Skinning, out: &mut Vec<Vec3>) {
        out.resize(vertices.len(), Vec3::ZERO);
        let k = self.influences;
        let count = vertices.len();
        let chunks = out
            .par_chunks_mut(CHUNK)
            .zip(vertices.par_chunks(CHUNK))
            .zip(self.indices[..count * k].par_chunks(CHUNK * k))
            .zip(self.weights[..count * k].par_chunks(CHUNK * k));
        match skinning {
            Skinning::Linear => {
                let rows: Vec<[f32; 12]> = palette.matrices.iter().map(rows).collect();
                chunks.for_each(|(((out, vertices), indices), weights)| {
                    for (i, (out, &v)) in out.iter_mut().zip(vertices).enumerate() {
                        let mut sum = [0.0f32; 12];
                        for (&bone, &weight) in indices[i * k..][..k].iter().zip(&weights[i * k..][..k]) {
                            let own = &rows[usize::from(bone)];
                            for c in 0..12 {
                                sum[c] += weight * own[c];
                            }
                        }
                        *out = applied(&sum, v);
                    }
                });
            }
            Skinning::DualQuaternion => {
                let duals: Vec<Dual> = palette.matrices.iter().map(Dual::new).collect();
                chunks.for_each(|(((out, vertices), indices), weights)| {
                    for (i, (out, &v)) in out.iter_mut().zip(vertices).enumerate() {
                        let own = indices[i * k..][..k].iter().map(|&bone| &duals[usize::from(bone)]);
                        *out = Dual::blend(own.zip(weights[i * k..][..k].iter().copied()), v);
                    }
                });
            }
        }
    }
}

/// The motions of bones at one instant.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Palette {
    /// M_b, from the mesh's space to the body's.
    pub matrices: Vec<DAffine3>,
}

impl Palette {
    /// Writes to `out` what the kernels read of the bones, [`Skinning::bone_vectors`] each: the
    /// rows of M_b, or else the real and the dual part of D_b (x y z w) and the columns of A_b,
    /// after which a 0 follows.
    pub fn pack(&self, skinning: Skinning, out: &mut Vec<Vec4>) {
        out.clear();
        match skinning {
            Skinning::Linear => out.extend(self.matrices.iter().flat_map(|own| {
                let own = rows(own);
                [0, 4, 8].map(|first| Vec4::from_slice(&own[first..first + 4]))
            })),
            Skinning::DualQuaternion => out.extend(self.matrices.iter().flat_map(|own| {
                let Dual { real, dual, stretch } = Dual::new(own);
                let [x, y, z] = [stretch.x_axis, stretch.y_axis, stretch.z_axis].map(|axis| axis.extend(0.0));
                [real, dual, x, y, z]
            })),
        }
    }
}

/// The rows of `affine`, the translation last in each.
fn rows(affine: &DAffine3) -> [f32; 12] {
    let (m, t) = (affine.matrix3.as_mat3().transpose(), affine.translation.as_vec3());
    let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis];
    [x.x, x.y, x.z, t.x, y.x, y.y, y.z, t.y, z.x, z.y, z.z, t.z]
}

fn applied(m: &[f32; 12], v: Vec3) -> Vec3 {
    let row = |r: usize| m[r] * v.x + m[r + 1] * v.y + m[r + 2] * v.z + m[r + 3];
    Vec3::new(row(0), row(4), row(8))
}

/// A rigid motion as a dual quaternion, and the stretch before it.
#[derive(Clone, Copy, Debug)]
struct Dual {
    real: Vec4,
    dual: Vec4,
    stretch: glam::Mat3,
}

impl Dual {
    fn new(motion: &DAffine3) -> Self {
        let rotation = nearest_rotation(&motion.matrix3);
        let stretch = DMat3::from_quat(rotation.conjugate()) * motion.matrix3;
        let t = motion.translation * 0.5;
        let dual = DQuat::from_xyzw(t.x, t.y, t.z, 0.0) * rotation;
        let vec4 = |q: DQuat| Vec4::from(q.as_quat());
        Self { real: vec4(rotation), dual: vec4(dual), stretch: stretch.as_mat3() }
    }

    /// Moves `v` by the blend of motions with weights, the largest weight first.
    fn blend<'a>(own: impl Iterator<Item = (&'a Self, f32)>, v: Vec3) -> Vec3 {
        let (mut real, mut dual, mut stretched) = (Vec4::ZERO, Vec4::ZERO, Vec3::ZERO);
        for (own, weight) in own {
            let signed = if real.dot(own.real) < 0.0 { -weight } else { weight };
            real += own.real * signed;
            dual += own.dual * signed;
            stretched += own.stretch * v * weight;
        }
        let inverse = 1.0 / real.length();
        let (real, dual) = (real * inverse, dual * inverse);
        let q = Quat::from_vec4(real);
        let shift = Quat::from_vec4(dual) * q.conjugate();
        q * stretched + Vec3::new(shift.x, shift.y, shift.z) * 2.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn bones(count: usize) -> Vec<Bone> {
        (0..count).map(|joint| Bone { joint, inverse_bind: DAffine3::IDENTITY }).collect()
    }

    fn deformed(weights: Vec<(usize, f32)>, motions: &[DAffine3], skinning: Skinning, v: Vec3) -> Vec3 {
        let (skin, _) = Skin::new(bones(motions.len()), vec![weights]);
        let (mut palette, mut out) = (Palette::default(), Vec::new());
        skin.palette(motions, &mut palette);
        skin.deform(&[v], &palette, skinning, &mut out);
        out[0]
    }

    #[test]
    fn a_rigid_motion_moves_a_vertex_alike_in_both_ways() {
        let motion =
            DAffine3::from_rotation_translation(DQuat::from_rotation_y(2.5), DVec3::new(1.0, -2.0, 0.5));
        let v = Vec3::new(0.3, 0.2, -0.7);
        let exact = motion.transform_point3(v.as_dvec3()).as_vec3();
        for skinning in [Skinning::Linear, Skinning::DualQuaternion] {
            let both = deformed(vec![(0, 0.3), (1, 0.7)], &[motion; 2], skinning, v);
            assert!(both.distance(exact) < 5e-7, "{both} {exact}");
        }
    }

    #[test]
    fn a_twist_keeps_its_girth_with_dual_quaternions_only() {
        let motions = [DAffine3::IDENTITY, DAffine3::from_rotation_x(PI * 0.9)];
        let at = |skinning| deformed(vec![(0, 0.5), (1, 0.5)], &motions, skinning, Vec3::Y).length();
        assert!((at(Skinning::DualQuaternion) - 1.0).abs() < 1e-6);
        assert!(at(Skinning::Linear) < 0.2);
        // The mean of two turns about an axis is the turn between them.
        let motions = [DAffine3::IDENTITY, DAffine3::from_rotation_x(FRAC_PI_2)];
        let mean = deformed(vec![(0, 0.5), (1, 0.5)], &motions, Skinning::DualQuaternion, Vec3::Y);
        assert!(mean.distance(Vec3::new(0.0, 0.5f32.sqrt(), 0.5f32.sqrt())) < 1e-6);
    }

    #[test]
    fn stretch_and_opposite_signs_are_blended() {
        let stretch = DAffine3::from_scale(DVec3::new(1.0, 2.0, 1.0));
        let v = deformed(
            vec![(0, 0.5), (1, 0.5)],
            &[stretch, DAffine3::IDENTITY],
            Skinning::DualQuaternion,
            Vec3::ONE,
        );
        assert!(v.distance(Vec3::new(1.0, 1.5, 1.0)) < 1e-6);
        // Turns by 179° and 181° are near each other, their quaternions are not.
        let turn = |degrees: f64| DAffine3::from_rotation_z(degrees.to_radians());
        let v = deformed(
            vec![(0, 0.5), (1, 0.5)],
            &[turn(179.0), turn(181.0)],
            Skinning::DualQuaternion,
            Vec3::X,
        );
        assert!(v.distance(Vec3::NEG_X) < 1e-6);
    }

    #[test]
    fn bones_are_packed_as_the_kernels_read_them() {
        let turn = DQuat::from_rotation_x(FRAC_PI_2);
        let motion = DAffine3::from_scale_rotation_translation(
            DVec3::new(1.0, 2.0, 3.0),
            turn,
            DVec3::new(4.0, 5.0, 6.0),
        );
        let palette = Palette { matrices: vec![DAffine3::IDENTITY, motion] };
        let mut packed = Vec::new();
        let v = Vec3::new(0.3, -0.2, 0.9);
        palette.pack(Skinning::Linear, &mut packed);
        assert_eq!(packed.len(), 2 * Skinning::Linear.bone_vectors());
        let rows = packed[3..].iter().map(|row| row.dot(v.extend(1.0)));
        let exact = motion.transform_point3(v.as_dvec3()).as_vec3();
        assert!(rows.zip(exact.to_array()).all(|(a, b)| (a - b).abs() < 1e-6));
        palette.pack(Skinning::DualQuaternion, &mut packed);
        assert_eq!(packed.len(), 2 * Skinning::DualQuaternion.bone_vectors());
        assert_eq!(packed[..2], [Vec4::W, Vec4::ZERO]);
        assert!((packed[5] - Vec4::from(turn.as_quat())).length() < 1e-6);
        let shift = Quat::from_vec4(packed[6]) * Quat::from_vec4(packed[5]).conjugate();
        assert!((shift.xyz() * 2.0).distance(Vec3::new(4.0, 5.0, 6.0)) < 1e-5);
        assert!((packed[8] - Vec4::Y * 2.0).length() < 1e-6);
    }

    #[test]
    fn weights_are_repaired_and_what_was_changed_is_said() {
        let vertices = vec![
            vec![(0, 0.25), (1, 0.25), (0, 0.5)],
            vec![(1, 3.0), (0, 1.0), (7, 5.0), (0, f32::NAN), (1, -2.0)],
            vec![(5, 1.0)],
        ];
        let (skin, report) = Skin::new(bones(2), vertices);
        assert_eq!(report, SkinReport { reduced: 0, rescaled: 1, unbound: 1 });
        assert_eq!(report.sentences().len(), 2);
        let of = |vertex| skin.of_vertex(vertex).collect::<Vec<_>>();
        assert_eq!(of(0), [(0, 0.75), (1, 0.25)]);
        assert_eq!(of(1), [(1, 0.75), (0, 0.25)]);
        assert_eq!(of(2), [(0, 1.0), (0, 0.0)]);
        let (skin, report) = Skin::new(bones(12), vec![(0..12).map(|bone| (bone, 1.0)).collect()]);
        assert_eq!((skin.influences(), report.reduced), (MAX_INFLUENCES, 1));
        assert!((skin.of_vertex(0).map(|own| own.1).sum::<f32>() - 1.0).abs() < 1e-6);
    }
}
