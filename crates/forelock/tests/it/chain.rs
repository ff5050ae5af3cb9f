//! A solver written outside the core, through its public interface alone, and a scene that runs it.
//! `docs/dev/add-a-solver.md` shows what stands between the marks.

#![expect(clippy::unwrap_used, reason = "a test that cannot build its scene fails")]

// chain-begin
use forelock::core::collide::resolve_solids::SolidContacts;
use forelock::core::lane::{Lane, Mat3, V3};
use forelock::core::params::ParamsError;
use forelock::core::solver::{FrameContext, FrameRules, LaneGroup, LaneSolver, Solver, Substep};
use forelock::core::strands::{BlockView, Scratch};

/// Particles that fall, slowed by the air; the shared length pass makes chains of them.
#[derive(Clone, Debug)]
struct Chain {
    /// Drag rate, s⁻¹.
    drag: f64,
}

impl LaneSolver for Chain {
    /// Share of the velocity relative to the air that a substep leaves.
    type Terms = f64;

    fn name(&self) -> &'static str {
        "chain"
    }

    fn rules(&self) -> FrameRules {
        FrameRules { stage: "move_chain", substep_secs: SUBSTEP_SECS, ..FrameRules::default() }
    }

    fn validate(&self) -> Result<(), ParamsError> {
        let Self { drag: value } = *self;
        if value >= 0.0 {
            return Ok(());
        }
        Err(ParamsError::Range { name: "drag", value, expected: "0 or more".to_owned() })
    }

    fn terms(&self, dt_secs: f64) -> f64 {
        (-self.drag * self.rules().h(dt_secs)).exp()
    }

    #[inline(always)]
    fn solve<L: Lane>(
        keep: &f64,
        cx: &FrameContext<'_, L::Scalar>,
        substep: Substep,
        view: &mut BlockView<'_, L::Scalar>,
        group: LaneGroup,
        _: &mut Scratch<L::Scalar>,
    ) -> SolidContacts {
        let (h, inverse_h) = (L::from_f64(cx.h), L::from_f64(1.0 / cx.h));
        let head = &cx.poses[substep.index + 1];
        let (turn, shift) = (Mat3::splat(head.matrix()), V3::splat(head.translation));
        let gravity = V3::<L>::splat(cx.gravity * cx.h);
        let keep = L::from_f64(*keep);
        for i in 0..view.particles {
            let x = V3::<L>::load(view.positions, i, group.first);
            let (x, v) = if i < cx.rules.clamped {
                let on_head = shift.add_mul(&turn, V3::load(view.rest, i, group.first));
                (on_head, (on_head - x).scale(inverse_h))
            } else {
                // The wind at this particle if it differs from place to place.
                let air = match view.wind.is_empty() {
                    true => V3::<L>::splat(cx.air_velocity),
                    false => V3::load(view.wind, i, group.first),
                };
                let slip = V3::load(view.velocities, i, group.first) - air;
                let v = air + slip.scale(keep) + gravity;
                (x.add_scaled(h, v), v)
            };
            x.store(view.positions, i, group.first);
            v.store(view.velocities, i, group.first);
        }
        SolidContacts::default()
    }
}

/// Longest substep, seconds.
const SUBSTEP_SECS: f64 = 1.0 / 240.0;

/// The solver of `[solver.chain]`.
fn chain(table: &toml::Table) -> Result<Solver<f32>, String> {
    if let Some(key) = table.keys().find(|key| *key != "drag") {
        return Err(format!("there is no key {key}"));
    }
    let drag = table.get("drag").and_then(|value| value.clone().try_into().ok());
    let drag = drag.ok_or("drag must be a number")?;
    Ok(Solver::new(Chain { drag }))
}
// chain-end

use forelock::{Player, Scene};
use glam::Vec3;
use std::path::Path;

const SCENE: &str = "[groom]\nstrands = 50\nvertices_per_strand = 12\npreset = \"straight\"\n\
                     [body]\nmotion = \"builtin:still\"\nsdf_cells = 32\n\
                     [solver]\nkind = \"chain\"\n[solver.chain]\ndrag = 4.0\n";

fn player(keys: &str) -> Player {
    let text = format!("{SCENE}{keys}");
    let scene = Scene::parse_with(&text, Path::new("scene.toml"), &[], &["chain"]).unwrap();
    Player::builder(scene).solver("chain", chain).build().unwrap()
}

#[test]
fn a_solver_from_outside_the_core_runs_in_a_scene() {
    let mut player = player("");
    let (mut before, mut after) = (Vec::new(), Vec::new());
    player.positions(&mut before).unwrap();
    let mut stretch = 0.0f64;
    for _ in 0..240 {
        let report = player.step().unwrap().solver;
        stretch = stretch.max(report.max_edge_stretch);
        assert!(report.stages.get("move_chain") > 0.0);
        assert_eq!(report.quarantined_strands, 0);
    }
    player.positions(&mut after).unwrap();
    // Lengths and roots hold, and hair without shape has fallen.
    assert!(stretch < 1e-3, "{stretch}");
    let offsets: Vec<usize> = player.groom().strand_offsets().iter().map(|&o| o as usize).collect();
    let height =
        |points: &[Vec3]| offsets.windows(2).map(|ends| f64::from(points[ends[1] - 1].y)).sum::<f64>() / 50.0;
    assert!(height(&after) < height(&before) - 0.005, "{} {}", height(&before), height(&after));
    for ends in offsets.windows(2) {
        assert!(after[ends[0]].distance(before[ends[0]]) < 1e-5);
    }
}

#[test]
fn it_works_with_interactions_and_snapshots() {
    let keys = "[interaction]\nkind = \"grid\"\ncontacts = true\n";
    let mut first = player(keys);
    let mut same = player(keys);
    for _ in 0..10 {
        first.step().unwrap();
    }
    let snapshot = first.snapshot().unwrap();
    for _ in 0..10 {
        first.step().unwrap();
    }
    same.restore(&snapshot).unwrap();
    for _ in 0..10 {
        same.step().unwrap();
    }
    assert_eq!(first.state_hash().unwrap(), same.state_hash().unwrap());
}

#[test]
fn its_table_is_checked() {
    let built = |drag: &str| {
        let text = SCENE.replace("drag = 4.0", drag);
        let scene = Scene::parse_with(&text, Path::new("scene.toml"), &[], &["chain"]).unwrap();
        Player::builder(scene).solver("chain", chain).build().map(drop).map_err(|error| error.to_string())
    };
    assert_eq!(built("drag = 4"), Ok(()));
    for (keys, message) in
        [("drag = -1", "0 or more"), ("drag = \"x\"", "must be a number"), ("dragg = 4.0", "no key dragg")]
    {
        let error = built(keys).unwrap_err();
        assert!(error.contains(message), "{keys}: {error}");
    }
}

#[test]
fn the_page_shows_this_solver() {
    let page = include_str!("../../../../docs/dev/add-a-solver.md");
    let own = include_str!("chain.rs").split("// chain-begin\n").nth(1).unwrap_or_default();
    let own = own.split("// chain-end").next().unwrap_or_default();
    assert!(own.len() > 1000 && page.contains(own.trim()), "the page and the test differ");
}
