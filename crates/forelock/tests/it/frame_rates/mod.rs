//! The same motion at several frame rates: how far tips are apart at equal times.

use forelock::Scene;
use forelock::player::Player;
use forelock::scene::Override;
use glam::Vec3;

/// Whatever the scene or the player says.
type Failure = Box<dyn std::error::Error>;

/// Hair that grows on the built-in head.
pub struct Hair {
    pub name: &'static str,
    pub preset: &'static str,
    /// Metres.
    pub length: f64,
}

pub const HAIR: [Hair; 4] = [
    Hair { name: "straight, 8 cm", preset: "straight", length: 0.08 },
    Hair { name: "straight, 30 cm", preset: "straight", length: 0.3 },
    Hair { name: "curly, 10 cm", preset: "curly", length: 0.1 },
    Hair { name: "curly, 35 cm", preset: "curly", length: 0.35 },
];

/// A motion of the head.
pub struct HeadMotion {
    pub name: &'static str,
    /// Factor on the angles and shifts of the built-in one.
    pub amplitude: f64,
}

/// The built-in turn, and the built-in shake three times as wide: 4 g at the sides of the head.
pub const MOTIONS: [HeadMotion; 2] = [
    HeadMotion { name: "builtin:turn", amplitude: 1.0 },
    HeadMotion { name: "builtin:shake", amplitude: 3.0 },
];

/// Tips at each frame.
pub struct Run {
    /// Frames a second.
    fps: u32,
    /// Metres, one list a frame.
    tips: Vec<Vec<Vec3>>,
    /// Lengths of the strands, metres.
    lengths: Vec<f32>,
}

/// A player of `hair` under `motion` at `fps`, with `sets` laid over the scene.
pub fn player(hair: &Hair, motion: &HeadMotion, fps: u32, sets: &[Override]) -> Result<Player, Failure> {
    let text = format!(
        "[time]\nfps = {fps}\n[groom]\nstrands = 60\npreset = \"{}\"\n\
         [groom.grow]\nstep = {}\nvertices_per_strand = 25\n\
         [body]\nsdf_cells = 48\nmotion = {{ name = \"{}\", amplitude = {} }}\n",
        hair.preset,
        hair.length / 24.0,
        motion.name,
        motion.amplitude
    );
    let scene = Scene::parse(&text, std::path::Path::new("frame-rates.toml"), sets)?;
    Ok(Player::new(scene)?)
}

/// Runs it for `secs` seconds.
pub fn run(hair: &Hair, motion: &HeadMotion, fps: u32, secs: u32, sets: &[Override]) -> Result<Run, Failure> {
    let mut player = player(hair, motion, fps, sets)?;
    let groom = player.groom();
    let ends: Vec<usize> = groom.strand_offsets()[1..].iter().map(|&end| end as usize - 1).collect();
    let length = |s: usize| groom.strand(s).windows(2).map(|edge| edge[0].distance(edge[1])).sum();
    let lengths = (0..groom.strand_count()).map(length).collect();
    let (mut tips, mut positions) = (Vec::new(), Vec::new());
    for _ in 0..secs * fps {
        player.step()?;
        player.positions(&mut positions)?;
        tips.push(ends.iter().map(|&end| positions[end]).collect());
    }
    Ok(Run { fps, tips, lengths })
}

/// Distances of tips over the lengths of their strands, at all times that are frames of both.
#[derive(Clone, Copy, Debug, Default)]
pub struct Apart {
    /// Over all strands and times.
    pub mean: f32,
    /// Of any strand at any time.
    pub worst: f32,
    /// Frames that were compared.
    pub frames: u32,
}

/// The index of the frame at time `at` over `fps`, if there is one.
fn frame_at(at: u32, fps: u32) -> Option<u32> {
    if at.is_multiple_of(fps) { (at / fps).checked_sub(1) } else { None }
}

/// How far the tips of `a` and `b` are apart at equal times.
pub fn apart(a: &Run, b: &Run) -> Apart {
    let mut apart = Apart::default();
    for (i, a_tips) in (1u32..).zip(&a.tips) {
        let at = i * b.fps;
        let Some(b_tips) = frame_at(at, a.fps).and_then(|frame| b.tips.get(frame as usize)) else {
            continue;
        };
        apart.frames += 1;
        for ((p, q), length) in a_tips.iter().zip(b_tips).zip(&a.lengths) {
            let far = p.distance(*q) / length;
            apart.mean += far;
            apart.worst = apart.worst.max(far);
        }
    }
    apart.mean /= (apart.frames as usize * a.lengths.len()).max(1) as f32;
    apart
}
