//! Root frames, uv coordinates and locks.

use crate::golden::{error, load, numbers, vectors};
use forelock_core::lane::Simd;
use forelock_neural::codes::encoder::{CODE, CodeOptions, INPUTS, StrandCodes};
use forelock_neural::codes::{
    LOCK_SIZE, Locks, LocksError, RootFrameError, crown_uv, encoder_inputs, local_strand, root_frame,
};
use glam::{DMat3, DVec3};
use std::f64::consts::PI;
use std::num::NonZeroUsize;

#[test]
fn root_frames_are_the_golden_ones() {
    let file = load("net_3_root_local");
    let normals = vectors(&file["normal"]);
    let points: Vec<DVec3> = vectors(&file["x"]).into_iter().map(DVec3::from).collect();
    let (mut frames, mut local) = (Vec::new(), Vec::new());
    for (&n, strand) in normals.iter().zip(points.chunks_exact(25)) {
        frames.extend(root_frame(n.into()).unwrap().transpose().to_cols_array());
        local.extend(local_strand(strand, n.into()).unwrap().into_iter().flat_map(|x| x.to_array()));
    }
    assert!(error(&frames, &numbers(&file["T"])) < 1e-9);
    assert!(error(&local, &numbers(&file["x_local"])) < 1e-9);
    let inputs = encoder_inputs(&points[..25], normals[0].into()).unwrap();
    let scaled: Vec<f64> = inputs.iter().map(|&x| 10.0 * f64::from(x)).collect();
    assert!(error(&scaled, &local[..75]) < 1e-6);
}

#[test]
fn a_root_frame_is_a_rotation_away_from_the_axis_and_takes_x_on_it() {
    for i in 0..200 {
        let angle = f64::from(i) * 0.7;
        let n = DVec3::new(angle.sin(), (1.3 * angle).cos(), 0.9 * (2.1 * angle).sin());
        let frame = root_frame(3.0 * n).unwrap();
        assert!(
            (frame * frame.transpose() - DMat3::IDENTITY).to_cols_array().iter().all(|x| x.abs() < 1e-14)
        );
        assert!((frame * n.normalize() - DVec3::Y).length() < 1e-14);
        assert!((frame.determinant() - 1.0).abs() < 1e-14);
    }
    let on_axis = root_frame(DVec3::new(0.0, 1e-4, -1.0)).unwrap();
    assert_eq!(on_axis.row(0), DVec3::X);
}

#[test]
fn uv_is_the_angle_from_the_crown_in_the_direction_seen_from_above() {
    let close = |d: [f64; 3], uv: [f64; 2]| {
        let found = crown_uv(d.into()).unwrap();
        assert!((found[0] - uv[0]).abs() < 1e-15 && (found[1] - uv[1]).abs() < 1e-15, "{found:?}");
    };
    close([0.0, 7.0, 0.0], [0.0, 0.0]);
    close([2.0, 0.0, 0.0], [0.5, 0.0]);
    close([0.0, 0.0, -1.0], [0.0, -0.5]);
    close([0.0, 1.0, 1.0], [0.0, 0.25]);
    close([-1.0, -1.0, 0.0], [-0.75, 0.0]);
    close([0.0, -1.0, 0.0], [0.0, -1.0]);
    close([1e-9, 1.0, 0.0], [1e-9 / PI, 0.0]);
    close([1e-200, 1e-200, 0.0], [0.25, 0.0]);
    // Equidistant along every meridian.
    for i in 1..180 {
        for j in 0..36 {
            let (tilt, turn) = (f64::from(i).to_radians(), f64::from(10 * j).to_radians());
            let d = [tilt.sin() * turn.cos(), tilt.cos(), tilt.sin() * turn.sin()];
            close(d, [tilt / PI * turn.cos(), tilt / PI * turn.sin()]);
        }
    }
}

#[test]
fn bad_roots_are_errors() {
    assert!(matches!(root_frame(DVec3::ZERO), Err(RootFrameError::Direction(..))));
    assert!(matches!(crown_uv(DVec3::new(f64::NAN, 0.0, 1.0)), Err(RootFrameError::Direction(..))));
    assert_eq!(local_strand(&[], DVec3::Y), Err(RootFrameError::Empty));
    assert_eq!(local_strand(&[DVec3::ZERO, DVec3::INFINITY], DVec3::Y), Err(RootFrameError::Position(1)));
    assert_eq!(encoder_inputs(&[DVec3::ZERO; 24], DVec3::Y), Err(RootFrameError::Particles { found: 24 }));
}

#[test]
fn locks_and_mean_codes_are_the_golden_ones() {
    let file = load("net_2_locks");
    let uv: Vec<[f64; 2]> = numbers(&file["uv"]).chunks_exact(2).map(|p| [p[0], p[1]]).collect();
    let locks = Locks::new(&uv, LOCK_SIZE).unwrap();
    let labels: Vec<f64> = locks.labels().iter().map(|&l| f64::from(l)).collect();
    assert_eq!(labels, numbers(&file["labels"]));
    assert_eq!(locks.count(), 8);
    let means = locks.mean_codes(&numbers(&file["z"]), 4).unwrap();
    let of_strands: Vec<f64> =
        locks.labels().iter().flat_map(|&l| means[4 * l as usize..][..4].to_vec()).collect();
    assert!(error(&of_strands, &numbers(&file["z_lock"])) < 1e-9);
}

#[test]
fn locks_of_a_line_are_its_pieces_in_order() {
    let uv: Vec<[f32; 2]> = (0..10).map(|i| [0.0, i as f32]).collect();
    let locks = Locks::new(&uv, NonZeroUsize::new(3).unwrap()).unwrap();
    assert_eq!(locks.labels(), [0, 0, 1, 1, 1, 2, 2, 3, 3, 3]);
    assert_eq!(
        locks.mean_codes(&[1.0f32, 3.0, 0.0, 0.0, 6.0, 5.0, 5.0, 1.0, 1.0, 1.0], 1).unwrap(),
        [2.0, 2.0, 5.0, 1.0]
    );
}

#[test]
fn roots_at_one_point_and_ties_keep_their_order() {
    let locks = Locks::new(&[[0.5f32; 2]; 130], LOCK_SIZE).unwrap();
    // 130 → 65 + 65 → 32 + 33 each.
    let expected: Vec<u32> = [32, 33, 32, 33].iter().zip(0..).flat_map(|(&n, l)| vec![l; n]).collect();
    assert_eq!(locks.labels(), expected);
    // Equal extents: along u.
    let square = [[1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [0.0, 0.0]];
    assert_eq!(Locks::new(&square, NonZeroUsize::new(2).unwrap()).unwrap().labels(), [1, 0, 1, 0]);
}

#[test]
fn bad_locks_are_errors() {
    assert_eq!(Locks::new::<f64>(&[], LOCK_SIZE), Err(LocksError::Empty));
    assert_eq!(Locks::new(&[[0.0, 0.0], [0.0, f64::NAN]], LOCK_SIZE), Err(LocksError::Coordinates(1)));
    let locks = Locks::new(&[[0.0f64; 2]; 3], LOCK_SIZE).unwrap();
    assert_eq!(locks.mean_codes(&[0.0f64; 3], 0), Err(LocksError::Width));
    let error = locks.mean_codes(&[0.0f64; 5], 2).unwrap_err();
    assert_eq!(error.to_string(), "5 numbers of codes were given; 3 strands of 2 numbers need 6");
}

#[test]
fn codes_decode_alike_one_by_one_and_in_lanes() {
    let strands: Vec<[f32; INPUTS]> =
        (0..150u8).map(|s| std::array::from_fn(|k| (0.1 * f32::from(s) + k as f32).sin())).collect();
    let codes =
        StrandCodes::train(&strands, &CodeOptions { steps: 20, ..CodeOptions::default() }, &mut || ());
    let each: Vec<[f32; CODE]> = strands.iter().map(|strand| codes.encode(strand)).collect();
    let decoded: Vec<[f32; INPUTS]> = each.iter().map(|code| codes.decode(code)).collect();
    let largest = decoded.as_flattened().iter().fold(0.0f32, |most, x| most.max(x.abs()));
    assert!(largest > 0.1, "an untrained decoder gives almost nothing: {largest}");
    for simd in Simd::ALL.into_iter().filter(|simd| simd.is_supported()) {
        let lanes = codes.decode_all(each.as_flattened(), simd);
        assert_eq!(lanes.len(), strands.len());
        let pairs = lanes.as_flattened().iter().zip(decoded.as_flattened());
        let off = pairs.fold(0.0f32, |most, (a, b)| most.max((a - b).abs()));
        assert!(off < 1e-4 * largest, "{simd:?}: {off}");
    }
}
