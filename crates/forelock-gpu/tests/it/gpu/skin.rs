//! Skinning on a GPU, against the formulas in float64.

#![expect(clippy::unwrap_used, reason = "a test fails where it cannot be set up")]

use crate::common;
use forelock_core::body::character::{Bone, Character, Palette, Skin, Skinning};
use forelock_core::body::{Talker, Walker};
use forelock_gpu::{Gpu, GpuError, Skinner};
use glam::{DAffine3, DMat3, DQuat, DVec3, DVec4, Vec3};

/// How far places may be from float64 on a body of human size, metres.
const TOLERANCE: f64 = 1e-6;

/// Numbers from 0 to 1, always the same.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f64 / f64::from(1 << 24)
    }

    fn vector(&mut self, size: f64) -> DVec3 {
        DVec3::new(self.next() - 0.5, self.next() - 0.5, self.next() - 0.5) * 2.0 * size
    }
}

/// A rigid motion after a stretch along axes.
#[derive(Clone, Copy)]
struct Motion {
    rotation: DQuat,
    shift: DVec3,
    stretch: DVec3,
}

impl Motion {
    fn matrix(&self) -> DAffine3 {
        let turn = DMat3::from_quat(self.rotation) * DMat3::from_diagonal(self.stretch);
        DAffine3::from_mat3_translation(turn, self.shift)
    }
}

/// Equation 3.7.3 of glTF 2.0: x = Σ w_b M_b v.
fn blended_matrices(own: &[(usize, f32)], motions: &[Motion], v: DVec3) -> DVec3 {
    own.iter().map(|&(bone, weight)| motions[bone].matrix().transform_point3(v) * f64::from(weight)).sum()
}

/// Dual quaternion skinning; without the choice of signs if `naive`.
fn blended_duals(own: &[(usize, f32)], motions: &[Motion], v: DVec3, naive: bool) -> DVec3 {
    let (mut real, mut dual, mut stretched) = (DVec4::ZERO, DVec4::ZERO, DVec3::ZERO);
    for &(bone, weight) in own {
        let Motion { rotation, shift, stretch } = motions[bone];
        let moved = DQuat::from_vec4((shift * 0.5).extend(0.0)) * rotation;
        let weight = f64::from(weight);
        let is_far = !naive && real.dot(DVec4::from(rotation)) < 0.0;
        let signed = if is_far { -weight } else { weight };
        real += DVec4::from(rotation) * signed;
        dual += DVec4::from(moved) * signed;
        stretched += stretch * v * weight;
    }
    let (real, dual) = (DQuat::from_vec4(real / real.length()), DQuat::from_vec4(dual / real.length()));
    let shift = dual * real.conjugate();
    real * stretched + 2.0 * DVec3::new(shift.x, shift.y, shift.z)
}

/// A skin of `count` vertices within 1.8 m, each of which follows `influences` of `bones` bones.
fn skin(count: usize, influences: usize, bones: usize, numbers: &mut Numbers) -> (Skin, Vec<Vec3>) {
    let bones = (0..bones).map(|joint| Bone { joint, inverse_bind: DAffine3::IDENTITY });
    let bones: Vec<Bone> = bones.collect();
    let vertex = |_| {
        let first = (numbers.next() * bones.len() as f64) as usize;
        let weight = |i: usize| ((first + i) % bones.len(), 0.05 + numbers.next() as f32);
        (0..influences).map(weight).collect()
    };
    let weights = (0..count).map(vertex).collect();
    let vertices = (0..count).map(|_| numbers.vector(0.9).as_vec3()).collect();
    (Skin::new(bones, weights).0, vertices)
}

/// Motions of limbs: turns by up to 170° about points of the body, `stretch` of their sides.
fn motions(count: usize, stretch: f64, numbers: &mut Numbers) -> Vec<Motion> {
    let motion = |_| {
        let axis = numbers.vector(1.0).normalize_or(DVec3::Y);
        let rotation = DQuat::from_axis_angle(axis, 85f64.to_radians() * numbers.next());
        let pivot = numbers.vector(0.8);
        let stretch = DVec3::ONE + numbers.vector(stretch);
        Motion { rotation, shift: pivot - rotation * (stretch * pivot), stretch }
    };
    (0..count).map(motion).collect()
}

/// The places on the device.
fn posed(skinner: &mut Skinner, gpu: &Gpu, palette: &Palette, skinning: Skinning) -> Vec<Vec3> {
    let mut encoder = gpu.device().create_command_encoder(&Default::default());
    skinner.encode(&mut encoder, palette, skinning).unwrap();
    gpu.queue().submit([encoder.finish()]);
    skinner.read().unwrap()
}

/// The largest distance of `found` from `exact`, metres.
fn worst(found: &[Vec3], exact: impl Iterator<Item = DVec3>) -> f64 {
    found.iter().zip(exact).map(|(a, b)| a.as_dvec3().distance(b)).fold(0.0, f64::max)
}

/// Counts around the sizes of workgroups and dispatches, 1 to 8 bones a vertex, stretched bones:
/// both ways are as exact as float32 on a body of human size.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn vertices_are_where_the_formulas_say() {
    let gpu = common::gpu();
    let mut numbers = Numbers(7);
    for (k, count) in [1, 2, 255, 256, 257, 4000, 32_769, 3000].into_iter().enumerate() {
        let influences = k + 1;
        let (skin, vertices) = skin(count, influences, 24, &mut numbers);
        assert_eq!(skin.influences(), influences);
        let motions = motions(24, 0.3, &mut numbers);
        let palette = Palette { matrices: motions.iter().map(Motion::matrix).collect() };
        let mut skinner = Skinner::new(&gpu, &skin, &vertices).unwrap();
        let own: Vec<Vec<_>> = (0..count).map(|vertex| skin.of_vertex(vertex).collect()).collect();
        let points = || own.iter().zip(vertices.iter().map(|v| v.as_dvec3()));
        let mut on_cpu = Vec::new();
        for skinning in [Skinning::Linear, Skinning::DualQuaternion] {
            let found = posed(&mut skinner, &gpu, &palette, skinning);
            assert_eq!(found.len(), count);
            let exact = || {
                points().map(|(own, v)| match skinning {
                    Skinning::Linear => blended_matrices(own, &motions, v),
                    Skinning::DualQuaternion => blended_duals(own, &motions, v, false),
                })
            };
            skin.deform(&vertices, &palette, skinning, &mut on_cpu);
            let [found, of_cpu] = [&found, &on_cpu].map(|places| worst(places, exact()));
            println!("{skinning:?}, {count} vertices, {influences} bones: {found:.1e} m, CPU {of_cpu:.1e}");
            assert!(found <= TOLERANCE, "{skinning:?}, {count} vertices, {influences} bones: {found:e}");
        }
        // A palette in which two bones have changed places is seen.
        let mut other = palette.clone();
        other.matrices.swap(0, 1);
        other.matrices.rotate_left(1);
        let found = posed(&mut skinner, &gpu, &other, Skinning::Linear);
        let wrong = worst(&found, points().map(|(own, v)| blended_matrices(own, &motions, v)));
        assert!(wrong > 0.01, "{wrong}");
    }
}

/// Turns by 179° and 181° have quaternions of opposite signs.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn opposite_signs_are_blended() {
    let gpu = common::gpu();
    let mut numbers = Numbers(3);
    let turn = |degrees: f64| Motion {
        rotation: DQuat::from_rotation_z(degrees.to_radians()),
        shift: DVec3::new(0.2, -0.1, 0.4),
        stretch: DVec3::new(1.0, 1.2, 0.9),
    };
    // As matrices have them: the rotation by 181° is that by −179°.
    let motions = [turn(179.0), turn(-179.0), turn(178.0), turn(-177.0)];
    assert!(DVec4::from(motions[0].rotation).dot(DVec4::from(motions[1].rotation)) < -0.9);
    let palette = Palette { matrices: motions.iter().map(Motion::matrix).collect() };
    for influences in 2..=4 {
        let (skin, vertices) = skin(500, influences, 4, &mut numbers);
        let mut skinner = Skinner::new(&gpu, &skin, &vertices).unwrap();
        let found = posed(&mut skinner, &gpu, &palette, Skinning::DualQuaternion);
        let [right, naive] = [false, true].map(|naive| {
            let exact = vertices.iter().enumerate().map(|(vertex, v)| {
                blended_duals(&skin.of_vertex(vertex).collect::<Vec<_>>(), &motions, v.as_dvec3(), naive)
            });
            worst(&found, exact)
        });
        println!("{influences} bones: {right:.1e} m, without signs {naive:.1e} m");
        assert!(right <= TOLERANCE, "{influences} bones: {right:e}");
        assert!(naive > 0.1, "{influences} bones: {naive:e}");
    }
}

/// The clips of a character: its palettes and the vertices that its shapes displace, at `count`
/// times.
fn poses(own: &Character, count: u32) -> Vec<(Palette, Vec<Vec3>)> {
    let mut poses = Vec::new();
    for clip in own.clips() {
        for step in 0..count {
            let mut locals = own.skeleton().rest();
            let mut weights = vec![0.0; own.shapes().len()];
            clip.sample(clip.duration_secs() * f64::from(step) / f64::from(count), &mut locals, &mut weights);
            let (mut globals, mut palette) = (Vec::new(), Palette::default());
            own.skeleton().globals(&locals, &mut globals);
            own.skin().palette(&globals, &mut palette);
            let mut vertices = own.bound().positions.clone();
            for (shape, weight) in own.shapes().iter().zip(weights) {
                for &(vertex, delta) in &shape.deltas {
                    vertices[vertex as usize] += delta * weight as f32;
                }
            }
            poses.push((palette, vertices));
        }
    }
    poses
}

/// The figure that walks and the head that talks, whose mouth is a blend shape.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn characters_are_skinned_as_by_the_formula() {
    let gpu = common::gpu();
    for (name, own) in [("walker", Walker::builtin()), ("talker", Talker::builtin())] {
        let skin = own.skin();
        let mut skinner = Skinner::new(&gpu, skin, &own.bound().positions).unwrap();
        let (mut largest, mut moved, mut on_cpu) = ([0.0f64; 3], 0.0f64, Vec::new());
        for (palette, vertices) in poses(own, 5) {
            skinner.set_vertices(&vertices).unwrap();
            let found = posed(&mut skinner, &gpu, &palette, Skinning::Linear);
            let exact = || {
                vertices.iter().enumerate().map(|(vertex, v)| {
                    let of_bone = |(bone, weight): (usize, f32)| {
                        palette.matrices[bone].transform_point3(v.as_dvec3()) * f64::from(weight)
                    };
                    skin.of_vertex(vertex).map(of_bone).sum::<DVec3>()
                })
            };
            skin.deform(&vertices, &palette, Skinning::Linear, &mut on_cpu);
            largest[0] = largest[0].max(worst(&found, exact()));
            largest[1] = largest[1].max(worst(&on_cpu, exact()));
            moved = moved.max(worst(&own.rest().positions, exact()));
            let found = posed(&mut skinner, &gpu, &palette, Skinning::DualQuaternion);
            skin.deform(&vertices, &palette, Skinning::DualQuaternion, &mut on_cpu);
            largest[2] = largest[2].max(worst(&found, on_cpu.iter().map(|x| x.as_dvec3())));
        }
        let [linear, cpu, dual] = largest;
        println!("{name}: {linear:.1e} m, CPU {cpu:.1e}; dual quaternions from the CPU {dual:.1e}");
        assert!(linear <= TOLERANCE && dual <= TOLERANCE, "{name}: {linear:e}, {dual:e}");
        assert!(moved > 0.01, "{name} stands still: {moved}");
    }
}

/// What is of another skin is refused, and the buffer of a skin without vertices is not read.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn what_is_of_another_skin_is_refused() {
    let gpu = common::gpu();
    let (skin, vertices) = skin(10, 2, 3, &mut Numbers(1));
    let short = Skinner::new(&gpu, &skin, &vertices[1..]);
    assert_eq!(short.err(), Some(GpuError::Skin { what: "vertices", found: 9, expected: 10 }));
    let mut skinner = Skinner::new(&gpu, &skin, &vertices).unwrap();
    let other = Palette { matrices: vec![DAffine3::IDENTITY; 4] };
    let mut encoder = gpu.device().create_command_encoder(&Default::default());
    let refused = skinner.encode(&mut encoder, &other, Skinning::Linear);
    assert_eq!(refused, Err(GpuError::Skin { what: "bones", found: 4, expected: 3 }));
    assert!(matches!(skinner.set_vertices(&[]), Err(GpuError::Skin { found: 0, .. })));
    let empty = Skin::new(skin.bones().to_vec(), Vec::new()).0;
    assert_eq!(Skinner::new(&gpu, &empty, &[]).unwrap().read().unwrap(), [Vec3::ZERO; 0]);
}
