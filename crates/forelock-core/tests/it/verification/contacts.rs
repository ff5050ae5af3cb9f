//! Hair against hair, segment by segment.

use crate::rig::{DT, Random, Rig, Strand, assert_one_hash, largest, shake, tuft, vector};
use forelock_core::body::{ColliderFrame, Shape};
use forelock_core::interaction::contact::{ContactMoment, ContactParams, Contacts, ParticleRows};
use forelock_core::lane::Row;
use forelock_core::lane::Simd;
use forelock_core::pose::Pose;
use forelock_core::solver::ams::Inextensibility;
use forelock_core::solver::{AmsParams, Solver, XpbdParams};
use forelock_core::strands::{Model, Strands};
use glam::{DQuat, DVec3};

const SIDE: usize = 12;
const PARTICLES: usize = 25;
const WISP: usize = SIDE * SIDE;
/// Speed of each wisp, m/s.
const SPEED: f64 = 1.0;

/// Two wisps of straight strands that cross at a right angle as seen along x, 4 cm apart.
fn wisps() -> Vec<Strand> {
    let strand = |k: usize| {
        let (wisp, k) = (k / WISP, k % WISP);
        let side = 2.0 * wisp as f64 - 1.0;
        let down = DQuat::from_rotation_x(0.25 * std::f64::consts::PI * side) * DVec3::NEG_Y;
        let across = down.cross(DVec3::X);
        let (u, v) = ((k % SIDE) as f64 - 5.5, (k / SIDE) as f64 - 5.5);
        // About 1.5 mm apart, not in rows that fit each other.
        let jitter = 0.3e-3 * (k as f64 * 12.9898 + side).sin();
        let root = -0.12 * down + across * (1.5e-3 * u + jitter) + DVec3::X * (0.02 * side + 1.5e-3 * v);
        (0..PARTICLES).map(|i| (root + down * (0.01 * i as f64)).to_array()).collect()
    };
    (0..2 * WISP).map(strand).collect()
}

/// Over the pairs of segments, one of each wisp, that cross as seen along x: their number, and the
/// share of pairs in which the first wisp's segment has passed the second's.
fn beyond(positions: &[DVec3]) -> (usize, f64) {
    let (mut crossing, mut beyond) = (0usize, 0usize);
    for a in 0..WISP {
        for b in WISP..2 * WISP {
            for i in 0..PARTICLES - 1 {
                let [p, q] = [0, 1].map(|k| positions[a * PARTICLES + i + k]);
                for j in 0..PARTICLES - 1 {
                    let [r, s] = [0, 1].map(|k| positions[b * PARTICLES + j + k]);
                    let (e, f, g) = (q - p, s - r, r - p);
                    let across = e.y * f.z - e.z * f.y;
                    let (t, u) = ((g.y * f.z - g.z * f.y) / across, (g.y * e.z - g.z * e.y) / across);
                    if (0.0..1.0).contains(&t) && (0.0..1.0).contains(&u) {
                        crossing += 1;
                        beyond += usize::from((p + t * e).x > (r + u * f).x);
                    }
                }
            }
        }
    }
    (crossing, beyond as f64 / crossing.max(1) as f64)
}

/// The wisps thrown at each other: for each frame, the crossings and the share that has passed, and
/// the number of contacts.
fn throw(solver: &Solver<f32>, speed: f64, contacts: Option<&ContactParams>) -> (Vec<(usize, f64)>, usize) {
    let mut rig = Rig::<f32>::new(&wisps(), solver.clone(), Simd::Auto);
    rig.simulation.set_contacts(contacts).unwrap();
    rig.edit(|snapshot| {
        for (k, v) in snapshot.velocities.iter_mut().enumerate() {
            let first = k < WISP * PARTICLES;
            *v = [if first { speed } else { -speed } as f32, 0.0, 0.0];
        }
    });
    let mut met = 0;
    let course = (0..24).map(|_| {
        met += rig.step(Pose::IDENTITY).strand_contacts.contacts;
        beyond(&rig.positions())
    });
    (course.collect(), met)
}

#[test]
fn wisps_thrown_at_each_other_do_not_pass_through() {
    let most = |course: &[(usize, f64)]| course.iter().map(|c| c.1).fold(0.0, f64::max);
    let usual = ContactParams::default();
    // Room for all 20,736 pairs that cross, and for those that others push through each other.
    let roomy = ContactParams { budget: 65_536, slip: 0.0, ..ContactParams::default() };
    let slipping = ContactParams { slip: usual.slip, ..roomy.clone() };
    let ams = Solver::from(&AmsParams::default());
    let rods = Solver::from(&XpbdParams::default());
    let published =
        Solver::from(&XpbdParams { inextensibility: Inextensibility::Off, ..XpbdParams::default() });
    // Relative speeds of 2 and 5 m/s, and the share of pairs that may change sides for a frame.
    for (solver, contacts, bounds) in [
        (&ams, &usual, [0.01, 0.05]),
        (&ams, &roomy, [1e-4; 2]),
        (&rods, &roomy, [1e-4; 2]),
        (&published, &roomy, [1e-4; 2]),
        (&ams, &slipping, [3e-3; 2]),
        (&rods, &slipping, [3e-3; 2]),
        (&published, &slipping, [3e-3; 2]),
    ] {
        for (speed, bound) in [SPEED, 2.5 * SPEED].into_iter().zip(bounds) {
            let (without, _) = throw(solver, speed, None);
            let (with, met) = throw(solver, speed, Some(contacts));
            println!(
                "{}, {} m/s, budget {}, slip {}: segment pairs that changed sides, at most: {:.3} % with contacts ({met} of them), {:.1} % without",
                solver.name(),
                2.0 * speed,
                contacts.budget,
                contacts.slip,
                100.0 * most(&with),
                100.0 * most(&without)
            );
            // Later some have bounced back so far that they no longer cross.
            let last = with[11];
            assert!(with[..12].iter().all(|c| c.0 > 5_000), "too few crossings");
            assert!(most(&without) > 0.8 && most(&with) <= bound && last.1 == 0.0);
        }
    }
}

/// Free strands, their contacts, and what changes.
struct Free {
    model: Model<f32>,
    positions: Vec<Row<f32>>,
    velocities: Vec<Row<f32>>,
    contacts: Contacts,
}

impl Free {
    fn new(strands: &[Strand], params: &ContactParams) -> Self {
        let positions: Vec<[f32; 3]> = strands.iter().flatten().map(|p| p.map(|x| x as f32)).collect();
        let mut offsets = vec![0];
        offsets.extend(strands.iter().scan(0, |sum, s| {
            *sum += s.len() as u32;
            Some(*sum)
        }));
        let strands = Strands::new(&positions, &offsets);
        let model = Model::new(&strands).unwrap();
        let contacts = Contacts::new(&model, params, Simd::Auto.resolve());
        let (positions, velocities) = (model.rest.clone(), vec![Row([0.0; 16]); model.rest.len()]);
        Self { model, positions, velocities, contacts }
    }

    /// Calls `f` with strand, position and velocity of each particle.
    fn each(&mut self, mut f: impl FnMut(usize, &mut [f32; 3], &mut [f32; 3])) {
        for block in &self.model.blocks {
            for place in block.range() {
                for lane in 0..block.live {
                    let get = |rows: &[Row<f32>]| [0, 1, 2].map(|c| rows[3 * place + c].0[lane]);
                    let (mut x, mut v) = (get(&self.positions), get(&self.velocities));
                    f(block.strands[lane] as usize, &mut x, &mut v);
                    for c in 0..3 {
                        self.positions[3 * place + c].0[lane] = x[c];
                        self.velocities[3 * place + c].0[lane] = v[c];
                    }
                }
            }
        }
    }

    /// Moves by the velocities for a frame, and lets `act` change what is there then.
    fn advance<R>(
        &mut self,
        act: impl FnOnce(&mut Contacts, &Model<f32>, ParticleRows<'_, f32>, &ContactMoment<'_>) -> R,
    ) -> R {
        self.contacts.record_start(&self.model, &self.positions, &Pose::IDENTITY);
        self.each(|_, x, v| (0..3).for_each(|c| x[c] += v[c] * DT as f32));
        let mut clearance = vec![Row([f32::INFINITY; 16]); self.model.places()];
        let Self { model, positions, velocities, contacts } = self;
        let rows = ParticleRows { positions, velocities, clearance: &mut clearance };
        act(contacts, model, rows, &ContactMoment { head: &Pose::IDENTITY, clamped: 0, dt_secs: DT })
    }

    /// Moves for a frame, and resolves; contacts, farthest move.
    fn step(&mut self) -> (usize, f64) {
        let report = self.advance(|contacts, model, rows, moment| contacts.resolve(model, rows, moment));
        (report.contacts, report.farthest_m)
    }

    /// Moves for a frame, and lets friction act.
    fn hold(&mut self) {
        self.advance(|contacts, model, rows, moment| {
            let held = contacts.params().hold;
            contacts.hold(model, rows, moment, held);
        });
    }

    /// Σ v and Σ |v|, all particles of equal mass.
    fn momentum(&mut self) -> (DVec3, f64) {
        let (mut sum, mut size) = (DVec3::ZERO, 0.0);
        self.each(|_, _, v| {
            sum += vector(*v);
            size += vector(*v).length();
        });
        (sum, size)
    }
}

#[test]
fn momentum_is_kept_and_energy_only_lost() {
    let mut random = Random(7);
    let mut free = Free::new(&wisps(), &ContactParams::default());
    let mut throw: Vec<DVec3> = (0..2 * WISP).map(|_| 0.3 * random.vector()).collect();
    (0..2 * WISP).for_each(|s| throw[s].x += if s < WISP { SPEED } else { -SPEED });
    free.each(|strand, _, v| *v = throw[strand].as_vec3().to_array());
    let energy = |free: &mut Free| {
        let mut sum = 0.0;
        free.each(|_, _, v| sum += 0.5 * vector(*v).length_squared());
        sum
    };
    let (mut met, mut last) = (0, energy(&mut free));
    let (before, size) = free.momentum();
    let first = last;
    for _ in 0..6 {
        met += free.step().0;
        let now = energy(&mut free);
        assert!(now < last * (1.0 + 1e-6), "energy from {last} to {now}");
        last = now;
    }
    let error = (free.momentum().0 - before).length() / size;
    println!(
        "{met} contacts: momentum off by {error:.1e} of its sum, energy {:.3} of what it was",
        last / first
    );
    assert!(met > 10_000 && last < 0.9 * first && error < 1e-6, "{met} {error:e}");
}

/// Friction holds strands that move slowly relative to their neighbours, slows down the others by
/// no more than its acceleration, and keeps momentum.
#[test]
fn friction_holds_slow_hair_and_keeps_momentum() {
    let params = ContactParams::default();
    let limit = params.hold * DT;
    for (speed, held) in [(0.3 * limit, true), (20.0 * limit, false)] {
        let mut random = Random(11);
        let mut free = Free::new(&wisps(), &params);
        let throw: Vec<DVec3> = (0..2 * WISP).map(|_| speed * random.vector()).collect();
        let drift = DVec3::new(0.2, 0.1, 0.0);
        free.each(|strand, _, v| *v = (drift + throw[strand]).as_vec3().to_array());
        let spread = |free: &mut Free| {
            let (mut sum, mut squares, mut count) = (DVec3::ZERO, 0.0, 0.0);
            free.each(|_, _, v| {
                sum += vector(*v);
                squares += vector(*v).length_squared();
                count += 1.0;
            });
            (squares / count - (sum / count).length_squared()).sqrt()
        };
        let (before, (momentum, size)) = (spread(&mut free), free.momentum());
        free.hold();
        let after = spread(&mut free);
        let error = (free.momentum().0 - momentum).length() / size;
        println!(
            "{speed:.4} m/s: relative motion {before:.5} to {after:.5} m/s, momentum off by {error:.1e}"
        );
        assert!(error < 1e-6, "{error:e}");
        if held {
            assert!(after < 0.1 * before, "{after}");
        } else {
            assert!(after < before && before - after < limit, "{before} {after}");
        }
    }
}

/// Friction never enlarges the sum of the squared velocities, however many strands there are and
/// whatever share of them it holds: a motion that it enlarged would grow from rounding.
#[test]
fn friction_enlarges_no_motion() {
    let params = ContactParams::default();
    let limit = params.hold * DT;
    for count in [12, 48, 300, 1000] {
        for speed in [0.1 * limit, limit, 5.0 * limit] {
            let mut random = Random(13);
            let mut free = Free::new(&tuft(count, 12), &params);
            free.each(|_, _, v| *v = (speed * random.vector()).as_vec3().to_array());
            let squares = |free: &mut Free| {
                let mut sum = 0.0;
                free.each(|_, _, v| sum += vector(*v).length_squared());
                sum
            };
            let first = squares(&mut free);
            let mut last = first;
            for frame in 0..60 {
                free.hold();
                let now = squares(&mut free);
                assert!(now < last * (1.0 + 1e-6), "{count}, {speed}: frame {frame}: {last} to {now}");
                last = now;
            }
            println!("{count} strands, {speed:.3} m/s: {:.3} of the squares are left", last / first);
            assert!(last < 0.5 * first, "{count}, {speed}: nothing is held");
        }
    }
}

/// Two strands that cross at their middles, thrown at each other: the relative velocity that
/// remains after contact.
#[test]
fn contacts_are_inelastic_with_coulomb_friction() {
    let strand = |x: f64, along: DVec3| -> Strand {
        (-4..4).map(|i| (DVec3::X * x + along * (0.01 * (f64::from(i) + 0.5))).to_array()).collect()
    };
    for (friction, left) in [(0.0, 1.0), (0.3, 0.7), (2.0, 0.0)] {
        let params = ContactParams { friction, rounds: 200, ..ContactParams::default() };
        let mut free = Free::new(&[strand(-1e-3, DVec3::Y), strand(1e-3, DVec3::Z)], &params);
        free.each(|s, _, v| *v = if s == 0 { [0.5, 0.0, 0.5] } else { [-0.5, 0.0, -0.5] });
        let (met, farthest) = free.step();
        // Means of the fourth and fifth particle of each.
        let mut middle = [(0, DVec3::ZERO, DVec3::ZERO); 2];
        free.each(|s, x, v| {
            let (i, at, u) = &mut middle[s];
            if (3..5).contains(i) {
                *at += 0.5 * vector(*x);
                *u += 0.5 * vector(*v);
            }
            *i += 1;
        });
        let (gap, u) = (middle[1].1.x - middle[0].1.x, middle[0].2 - middle[1].2);
        println!(
            "friction {friction}: {met} contact, gap {gap:.2e} m, relative velocity {u:.4}, moved {farthest:.1e}"
        );
        assert_eq!(met, 1);
        assert!((gap - params.distance).abs() < 0.15 * params.distance, "{gap}");
        assert!(u.x.abs() < 0.02 && (u.z - left).abs() < 0.03, "{u}");
    }
}

#[test]
fn hair_that_moves_with_the_head_is_untouched() {
    let strands = tuft(200, 12);
    let run = |contacts: Option<&ContactParams>| {
        let mut rig = Rig::<f32>::new(&strands, &AmsParams::default(), Simd::Auto);
        rig.simulation.set_contacts(contacts).unwrap();
        let params = AmsParams { clamped: 12, ..AmsParams::default() };
        rig.simulation.set_params(&params).unwrap();
        for frame in 1..=10 {
            let angle = 0.15 * f64::from(frame);
            let turn = Pose::new(DQuat::from_rotation_z(angle), DVec3::new(0.05 * angle, 0.0, 0.0));
            assert_eq!(rig.step(turn).strand_contacts.contacts, 0);
        }
        rig.simulation.state_hash()
    };
    assert_eq!(run(Some(&ContactParams { slip: 0.0, ..ContactParams::default() })), run(None));
}

/// Strands that are nearer than the contact distance at rest do not prevent each other from
/// returning to rest. Friction between neighbours is off: without sleep it does not fade, and by
/// itself it holds hair millimetres from its shape.
#[test]
fn hair_goes_back_to_its_rest_shape() {
    let strands = tuft(300, 12);
    let mut rig = Rig::<f32>::new(&strands, &AmsParams::default(), Simd::Auto);
    rig.simulation
        .set_contacts(Some(&ContactParams { distance: 3e-3, hold: 0.0, ..ContactParams::default() }))
        .unwrap();
    let rest = rig.positions();
    let mut met = 0;
    for frame in 1..=60 {
        met += rig.step(shake(0.3, 2.0, f64::from(frame) * DT)).strand_contacts.contacts;
    }
    let home = rig.head;
    let rest: Vec<DVec3> = rest.iter().map(|&x| home.transform_point(x)).collect();
    for _ in 0..180 {
        rig.step(home);
    }
    let off = largest(&rig.positions(), &rest);
    println!("{met} contacts in a shake; 3 s later the farthest particle is {off:.1e} m from its rest shape");
    assert!(met > 1000 && off < 5e-3, "{met} {off:e}");
}

/// Without a length pass, too, nothing that contacts moved is left inside a solid.
#[test]
fn solids_have_the_last_word() {
    let params = AmsParams { inextensibility: Inextensibility::Off, ..AmsParams::default() };
    let mut rig = Rig::<f32>::new(&tuft(300, 12), &params, Simd::Auto);
    let contact = ContactParams { distance: 3e-3, ..ContactParams::default() };
    rig.simulation.set_contacts(Some(&contact)).unwrap();
    let (shape, radius) = (Shape::Sphere { radius: 0.03 }, 0.03);
    let (mut met, mut touching) = (0, 0);
    for frame in 0..60 {
        let [from, to] = [frame, frame + 1]
            .map(|f| Pose::new(DQuat::IDENTITY, DVec3::new(-0.2 + 5e-3 * f64::from(f), -0.1, 0.0)));
        let ball = ColliderFrame { shape: &shape, local: Pose::IDENTITY, from, to, friction: 0.3 };
        let report = rig.step_among(Pose::IDENTITY, &[ball]);
        met += report.strand_contacts.contacts;
        touching += report.touching;
        for x in rig.positions() {
            let depth = radius - x.distance(to.translation);
            assert!(depth < 1e-5, "frame {frame}: {depth}");
        }
    }
    assert!(met > 500 && touching > 500, "{met} {touching}");
}

/// A strand that was thrown far away takes nothing from the others.
#[test]
fn a_strand_far_away_does_not_matter() {
    for far in [10.0f32, 1e20, f32::MAX] {
        let mut rig = Rig::<f32>::new(&tuft(300, 12), &AmsParams::default(), Simd::Auto);
        rig.simulation.set_contacts(Some(&ContactParams::default())).unwrap();
        rig.edit(|snapshot| {
            if let Some(last) = snapshot.positions.last_mut() {
                last[2] = far;
            }
        });
        let mut met = 0;
        for frame in 1..=30 {
            met += rig.step(shake(4.0, 2.0, f64::from(frame) * DT)).strand_contacts.contacts;
        }
        println!("{far:e} m: {met} contacts");
        assert!(met > 100, "{far}: {met}");
    }
}

/// Edges are restored after contacts only in blocks of sixteen strands that a contact has moved or
/// a collider stretched: hair elsewhere moves as without contacts, to the bit.
#[test]
fn blocks_without_contacts_keep_their_bits() {
    const APART: usize = 48;
    let mut strands = wisps();
    let strand = |k: usize| -> Strand {
        let root = DVec3::new(1.0 + 0.01 * k as f64, 0.0, 0.0);
        (0..PARTICLES).map(|i| (root + DVec3::NEG_Y * (0.01 * i as f64)).to_array()).collect()
    };
    strands.extend((0..APART).map(strand));
    let run = |contacts: Option<&ContactParams>| {
        let mut rig = Rig::<f32>::new(&strands, &AmsParams::default(), Simd::Auto);
        rig.simulation.set_contacts(contacts).unwrap();
        rig.edit(|snapshot| {
            for (k, v) in snapshot.velocities.iter_mut().enumerate() {
                *v = match k / PARTICLES / WISP {
                    0 => [1.0, 0.0, 0.0],
                    1 => [-1.0, 0.0, 0.0],
                    _ => [0.0, 0.3, 1.0],
                };
            }
        });
        let met: usize = (0..12).map(|_| rig.step(Pose::IDENTITY).strand_contacts.contacts).sum();
        (met, rig.positions())
    };
    let contacts = ContactParams { hold: 0.0, ..ContactParams::default() };
    let ((met, with), (_, without)) = (run(Some(&contacts)), run(None));
    let apart = 2 * WISP * PARTICLES;
    let moved = |range: std::ops::Range<usize>| range.filter(|&k| with[k] != without[k]).count();
    assert!(met > 1000 && moved(0..apart) > apart / 2, "{met}");
    assert_eq!(moved(apart..with.len()), 0);
}

/// The same bits for any number of threads and any instruction set with the same rounding.
#[test]
fn threads_and_widths_do_not_matter() {
    assert_one_hash(|simd| {
        let mut rig = Rig::<f32>::new(&tuft(300, 12), &AmsParams::default(), simd);
        rig.simulation.set_contacts(Some(&ContactParams::default())).unwrap();
        let mut met = 0;
        for frame in 1..=40 {
            met += rig.step(shake(4.0, 2.0, f64::from(frame) * DT)).strand_contacts.contacts;
        }
        assert!(met > 0, "strands never met");
        rig.simulation.state_hash()
    });
}
