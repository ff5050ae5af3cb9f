//! Hair against hair through the grid: what it keeps, and what it gives back.

use crate::rig::{DT, Rig, assert_one_hash, shake, tuft};
use forelock_core::interaction::grid::{Grid, GridFrame, GridMoment, GridParams, GridReport};
use forelock_core::lane::{LANES, Row};
use forelock_core::pose::Pose;
use forelock_core::solver::AmsParams;
use forelock_core::strands::vector;
use forelock_core::strands::{Model, Strands};
use glam::{DQuat, DVec3};

/// A ball of short free strands: 10 cm across, three particles 5 mm apart each.
fn ball() -> Model<f32> {
    let mut positions = Vec::new();
    for k in 0..24_000usize {
        // An irrational lattice: as even as a grid, but along no axis.
        let [x, y, z] = [0.819_172_513_4, 0.671_043_606_7, 0.549_700_477_9]
            .map(|a| ((k + 1) as f64 * a).fract() * 0.1 - 0.05);
        if (x * x + y * y + z * z).sqrt() < 0.05 {
            positions.extend([-5e-3, 0.0, 5e-3].map(|d| [x, y - d, z].map(|c| c as f32)));
        }
    }
    let offsets: Vec<u32> = (0..=positions.len() as u32 / 3).map(|s| 3 * s).collect();
    Model::new(&Strands::new(&positions, &offsets)).unwrap()
}

fn params() -> GridParams {
    GridParams { resolution: 16, ..GridParams::default() }
}

fn moment(frame: GridFrame) -> GridMoment<'static> {
    GridMoment { frame, solids: &[], last_substep: 0.75, origin: DVec3::ZERO, clamped: 0, dt_secs: DT }
}

fn still() -> GridFrame {
    GridFrame::new(&Pose::IDENTITY, &Pose::IDENTITY, DT / 4.0)
}

/// Calls `f` with place, lane and mass (metres of hair) of every particle.
fn each(model: &Model<f32>, mut f: impl FnMut(usize, usize, f64)) {
    for block in &model.blocks {
        for lane in 0..block.live {
            let length = |i: usize| f64::from(model.rest_lengths[3 * (block.first + i)].0[lane]);
            for i in 0..block.particles {
                let before = if i > 0 { length(i - 1) } else { 0.0 };
                f(block.first + i, lane, 0.5 * (before + length(i)));
            }
        }
    }
}

fn place(rows: &[Row<f32>], place: usize, lane: usize) -> DVec3 {
    DVec3::from_array(vector(rows, place, lane).map(f64::from))
}

fn fill(model: &Model<f32>, f: impl Fn(DVec3, usize) -> DVec3) -> Vec<Row<f32>> {
    let mut rows = model.rest.clone();
    for block in &model.blocks {
        for p in block.range() {
            for lane in 0..16 {
                let v = f(place(&model.rest, p, lane), 16 * p + lane);
                for c in 0..3 {
                    rows[3 * p + c].0[lane] = v[c] as f32;
                }
            }
        }
    }
    rows
}

/// Σ m v, Σ m |v|.
fn momentum(model: &Model<f32>, velocities: &[Row<f32>]) -> (DVec3, f64) {
    let (mut sum, mut size) = (DVec3::ZERO, 0.0);
    each(model, |p, lane, mass| {
        let v = place(velocities, p, lane);
        sum += mass * v;
        size += mass * v.length();
    });
    (sum, size)
}

/// A number from −1 to 1 that looks random.
fn noise(k: usize) -> f64 {
    2.0 * ((k as f64 * 12.9898).sin() * 43758.5453).fract().abs() - 1.0
}

#[test]
fn momentum_is_kept_to_rounding() {
    let model = ball();
    for (pic_rate, squeeze) in [(0.0, 0.9), (3.0, 0.9), (100.0, 0.7)] {
        let mut grid = Grid::new(&model, &GridParams { pic_rate, ..params() });
        let mut positions = fill(&model, |x, _| squeeze * x);
        let mut velocities =
            fill(&model, |x, k| -20.0 * x + DVec3::new(1.0 + noise(k), noise(k + 7) - 0.5, noise(k + 13)));
        let (before, size) = momentum(&model, &velocities);
        let old = velocities.clone();
        let report = grid.exchange(&model, &mut positions, &mut velocities, &mut [], &moment(still()));
        let (after, _) = momentum(&model, &velocities);
        let given: f64 = {
            let mut sum = 0.0;
            each(&model, |p, lane, m| {
                sum += m * (place(&velocities, p, lane) - place(&old, p, lane)).length()
            });
            sum
        };
        let error = (after - before).length() / size;
        println!(
            "momentum off by {error:.1e} of its sum, {:.0} % of it exchanged; {report:?}",
            100.0 * given / size
        );
        assert!(report.cells > 200 && given > 0.05 * size, "the grid did little: {report:?}");
        assert!(error < 1e-6, "{error:e}");
    }
}

#[test]
fn what_moves_with_the_head_is_untouched() {
    let model = ball();
    let mut grid = Grid::new(&model, &params());
    // A turn of 10 rad/s and 3 m/s: far, fast, tilted.
    let h = DT / 4.0;
    let now = Pose::new(DQuat::from_rotation_z(0.7), DVec3::ZERO);
    let before = Pose::new(
        DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), -10.0 * h) * now.rotation,
        DVec3::new(3.0, -1.0, 0.5) * -h,
    );
    let mut positions = fill(&model, |x, _| now.transform_point(x));
    let mut velocities = fill(&model, |x, _| (now.transform_point(x) - before.transform_point(x)) / h);
    let old = velocities.clone();
    let report = grid.exchange(
        &model,
        &mut positions,
        &mut velocities,
        &mut [],
        &moment(GridFrame::new(&before, &now, h)),
    );
    let mut worst = 0.0f64;
    each(&model, |p, lane, _| {
        worst = worst.max(
            (place(&velocities, p, lane) - place(&old, p, lane)).length() / place(&old, p, lane).length(),
        );
    });
    println!("rigid motion with the head changed by {worst:.1e} (at most 1e-5); {report:?}");
    assert!(worst < 1e-5, "{worst:e}");
}

#[test]
fn a_shift_against_the_head_is_untouched() {
    let model = ball();
    let mut grid = Grid::new(&model, &GridParams { pic_rate: 100.0, ..params() });
    let mut positions = model.rest.clone();
    let mut velocities = fill(&model, |_, _| DVec3::new(1.0, -2.0, 0.5));
    let old = velocities.clone();
    grid.exchange(&model, &mut positions, &mut velocities, &mut [], &moment(still()));
    let mut worst = 0.0f64;
    each(&model, |p, lane, _| {
        worst = worst.max((place(&velocities, p, lane) - place(&old, p, lane)).length())
    });
    assert!(worst < 1e-5 * 2.3, "{worst:e}");
}

/// The room of the ball over that at rest: from the mean square distance from its middle.
fn volume(model: &Model<f32>, positions: &[Row<f32>]) -> f64 {
    let (mut now, mut rest) = (0.0, 0.0);
    each(model, |p, lane, mass| {
        now += mass * place(positions, p, lane).length_squared();
        rest += mass * place(&model.rest, p, lane).length_squared();
    });
    (now / rest).powf(1.5)
}

/// `frames` of free hair that starts squeezed to `share` of its volume; the volume after each.
fn expand(share: f64, frames: usize) -> Vec<(f64, GridReport)> {
    let model = ball();
    let mut grid = Grid::new(&model, &params());
    let mut positions = fill(&model, |x, _| share.cbrt() * x);
    let mut velocities = fill(&model, |_, _| DVec3::ZERO);
    (0..frames)
        .map(|_| {
            for (x, v) in positions.iter_mut().zip(&velocities) {
                for lane in 0..16 {
                    x.0[lane] += v.0[lane] * DT as f32;
                }
            }
            let report = grid.exchange(&model, &mut positions, &mut velocities, &mut [], &moment(still()));
            (volume(&model, &positions), report)
        })
        .collect()
}

#[test]
fn a_squeezed_clump_comes_back_to_its_rest_density_and_no_further() {
    let course = expand(0.3, 180);
    let volumes: Vec<f64> = course.iter().map(|c| c.0).collect();
    println!(
        "squeezed to 30 %: after 0.25, 0.5, 1, 2, 3 s {:.3} {:.3} {:.3} {:.3} {:.3} of the rest volume; fullest {:.3}",
        volumes[14], volumes[29], volumes[59], volumes[119], volumes[179], course[59].1.densest
    );
    let most = volumes.iter().copied().fold(0.0, f64::max);
    assert!((volumes[59] - 1.0).abs() < 0.05, "after 1 s {}", volumes[59]);
    assert!(most < 1.05, "{most}");
}

#[test]
fn hair_at_rest_stays_where_it_is() {
    let course = expand(1.0, 60);
    let (volume, report) = course[59];
    println!("at rest: {volume:.6} of the volume; {report:?}");
    assert!((volume - 1.0).abs() < 1e-3, "{volume} {report:?}");
}

/// The same bits for any number of threads and any SIMD width of one rounding, also with a block
/// that is not full, on a head that turns: padding lanes stay behind and must not count.
#[test]
fn threads_and_widths_do_not_matter() {
    assert_one_hash(|simd| {
        let mut rig = Rig::<f32>::new(&tuft(18 * LANES + 1, 12), &AmsParams::default(), simd);
        rig.simulation.set_grid(Some(&params())).unwrap();
        let mut cells = 0;
        for frame in 1..=40 {
            let turned = DQuat::from_rotation_x(0.04 * f64::from(frame));
            let shaken = shake(4.0, 2.0, f64::from(frame) * DT);
            cells += rig.step(Pose { rotation: turned, ..shaken }).grid.cells;
        }
        assert!(cells > 0, "strands never met");
        rig.simulation.state_hash()
    });
}
