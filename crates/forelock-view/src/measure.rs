//! Colours that show what strands do instead of how they look.

use std::collections::HashMap;

use forelock::player::{Asked, Moment, Touch, Untold, WhyUntold};
use forelock_core::groom::Groom;
use forelock_core::pose::Pose;
use glam::Vec3;

/// The longest time between two frames from which a speed is taken, seconds.
const LONGEST_SECS: f64 = 0.25;

/// Side of the cells in which hair is counted, metres.
const CELL: f32 = 0.01;

/// What the colours of strands show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Measure {
    /// Hair.
    #[default]
    Hair,
    /// How much longer or shorter an edge is than at rest.
    Stretch,
    /// Speed relative to the head.
    Speed,
    /// Distance from the rest shape, in the frame of the head.
    Displacement,
    /// How much denser hair is around a particle than around it at rest.
    Density,
    /// By how much the tie to the rest shape has weakened.
    Damage,
    /// What a particle touched in the solver's last step.
    Contacts,
}

impl Measure {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::Hair,
        Self::Stretch,
        Self::Speed,
        Self::Displacement,
        Self::Density,
        Self::Damage,
        Self::Contacts,
    ];

    /// Its name in the window, and what the end of the scale stands for.
    pub fn words(self) -> (&'static str, &'static str) {
        match self {
            Self::Hair => ("Hair", ""),
            Self::Stretch => ("Stretch", "1 % longer or shorter"),
            Self::Speed => ("Speed", "2 m/s relative to the head"),
            Self::Displacement => ("Displacement", "10 cm from the rest shape"),
            Self::Density => ("Density", "twice as dense as at rest"),
            Self::Damage => ("Damage", "the tie to the rest shape is broken"),
            Self::Contacts => ("Contacts", ""),
        }
    }

    /// The value at the end of the scale: a ratio, m/s, metres.
    fn end(self) -> f32 {
        match self {
            Self::Hair | Self::Density | Self::Damage | Self::Contacts => 1.0,
            Self::Stretch => 0.01,
            Self::Speed => 2.0,
            Self::Displacement => 0.1,
        }
    }

    /// What it needs of moments besides positions.
    pub fn asks(self) -> Asked {
        Asked { damage: self == Self::Damage, contacts: self == Self::Contacts, grid: false }
    }

    /// Why it cannot be shown, if it cannot.
    pub fn untold(self, untold: &Untold) -> Option<WhyUntold> {
        match self {
            Self::Damage => untold.damage,
            Self::Contacts => untold.contacts,
            _ => None,
        }
    }

    /// Whether `moment` holds what it needs.
    pub fn is_told(self, moment: &Moment) -> bool {
        match self {
            Self::Damage => moment.told.damage.is_some(),
            Self::Contacts => moment.told.contacts.is_some(),
            _ => true,
        }
    }

    /// The colour of each particle of `moment`, linear RGB; none for hair, and where `moment` does
    /// not hold what it needs. `previous` is a frame before it, for speeds.
    pub fn colours(self, moment: &Moment, previous: Option<&Moment>) -> Option<Vec<[f32; 3]>> {
        let values = match self {
            Self::Hair => return None,
            Self::Stretch => stretches(moment),
            Self::Speed => speeds(moment, previous),
            Self::Displacement => displacements(moment),
            Self::Density => {
                let now: Vec<Vec3> = in_head(moment).collect();
                compressions(moment.groom(), &now)
            }
            Self::Damage => moment.told.damage.clone()?,
            Self::Contacts => {
                let touches = moment.told.contacts.as_ref()?;
                return Some(touches.iter().map(|own| colour_of(*own)).collect());
            }
        };
        Some(values.into_iter().map(|value| colour((value / self.end()).abs())).collect())
    }
}

/// The colour of a share of the scale, linear RGB: from blue over grey to orange.
pub fn colour(share: f32) -> [f32; 3] {
    const STOPS: [Vec3; 3] =
        [Vec3::new(0.03, 0.09, 0.3), Vec3::new(0.45, 0.42, 0.4), Vec3::new(0.75, 0.13, 0.01)];
    let at = if share > 0.0 { 2.0 * share.min(1.0) } else { 0.0 };
    let mixed = if at < 1.0 { STOPS[0].lerp(STOPS[1], at) } else { STOPS[1].lerp(STOPS[2], at - 1.0) };
    mixed.to_array()
}

/// The kinds of contacts, with their words in the window.
pub const TOUCHES: [(Touch, &str); 4] = [
    (Touch { strands: false, solids: false }, "none"),
    (Touch { strands: true, solids: false }, "with strands"),
    (Touch { strands: false, solids: true }, "with solids"),
    (Touch { strands: true, solids: true }, "with both"),
];

/// The colour of a kind of contact, linear RGB.
pub fn colour_of(touch: Touch) -> [f32; 3] {
    match (touch.strands, touch.solids) {
        (false, false) => colour(0.0),
        (true, false) => colour(1.0),
        (false, true) => [0.06, 0.5, 0.12],
        (true, true) => [0.85, 0.75, 0.5],
    }
}

/// Relative changes of length of the longer-changed edge at each particle.
fn stretches(moment: &Moment) -> Vec<f32> {
    let rest = moment.groom().positions();
    let mut values = vec![0.0_f32; moment.positions.len()];
    for range in moment.groom().strand_offsets().windows(2) {
        for i in range[0] as usize + 1..range[1] as usize {
            let now = moment.positions[i].distance(moment.positions[i - 1]);
            let own = (now / rest[i].distance(rest[i - 1]).max(1e-9) - 1.0).abs();
            values[i] = own;
            values[i - 1] = values[i - 1].max(own);
        }
    }
    values
}

/// Zero where `previous` is no frame shortly before.
fn speeds(moment: &Moment, previous: Option<&Moment>) -> Vec<f32> {
    let count = moment.positions.len();
    let Some(previous) = previous.filter(|own| own.positions.len() == count) else { return vec![0.0; count] };
    let secs = moment.time_secs - previous.time_secs;
    if secs <= 0.0 || secs > LONGEST_SECS {
        return vec![0.0; count];
    }
    let moved = in_head(moment).zip(in_head(previous)).map(|(now, before)| now.distance(before));
    moved.map(|distance| distance / secs as f32).collect()
}

fn displacements(moment: &Moment) -> Vec<f32> {
    in_head(moment).zip(moment.groom().positions()).map(|(now, rest)| now.distance(*rest)).collect()
}

/// By how much of its density at rest hair is denser around each particle, which is at `now` in the
/// frame of the head; 0 where it is looser.
fn compressions(groom: &Groom, now: &[Vec3]) -> Vec<f32> {
    let lengths = lengths(groom);
    let [at_rest, now] = [groom.positions(), now].map(|places| densities(places, &lengths));
    now.into_iter().zip(at_rest).map(|(now, rest)| (now / rest.max(1e-9) - 1.0).max(0.0)).collect()
}

/// The length of strand that each particle stands for: half of both edges at rest, metres.
fn lengths(groom: &Groom) -> Vec<f32> {
    let rest = groom.positions();
    let mut lengths = vec![0.0; rest.len()];
    for range in groom.strand_offsets().windows(2) {
        for i in range[0] as usize + 1..range[1] as usize {
            let half = 0.5 * rest[i].distance(rest[i - 1]);
            lengths[i] += half;
            lengths[i - 1] += half;
        }
    }
    lengths
}

/// The length of strand in the cell around each place, metres.
fn densities(places: &[Vec3], lengths: &[f32]) -> Vec<f32> {
    let cell = |place: &Vec3| (*place / CELL).floor().as_i64vec3();
    let mut cells: HashMap<_, f32> = HashMap::new();
    for (place, length) in places.iter().zip(lengths) {
        *cells.entry(cell(place)).or_default() += length;
    }
    places.iter().map(|place| cells.get(&cell(place)).copied().unwrap_or_default()).collect()
}

/// The particles in the frame of the head.
fn in_head(moment: &Moment) -> impl Iterator<Item = Vec3> + '_ {
    let back: Pose = moment.head.inverse();
    moment.positions.iter().map(move |x| back.transform_point(x.as_dvec3()).as_vec3())
}

#[cfg(test)]
mod tests {
    use super::*;
    use forelock::scene::Override;
    use forelock::{Backend, Player, Scene};

    #[test]
    fn hair_at_rest_is_blue_and_hair_in_motion_is_not() -> Result<(), Box<dyn std::error::Error>> {
        let sets = ["groom.strands=20", "body.sdf_cells=32"].map(Override::set);
        let sets = sets.into_iter().collect::<Result<Vec<_>, _>>()?;
        let mut player = Player::builder(Scene::builtin(&sets)?).backend(Backend::Cpu).build()?;
        let rest = player.moment()?;
        let measures = [Measure::Stretch, Measure::Speed, Measure::Displacement, Measure::Density];
        for measure in measures {
            let colours = measure.colours(&rest, None).ok_or("colours")?;
            assert_eq!(colours.len(), rest.positions.len());
            let is_blue = |own: &[f32; 3]| own[2] > 3.0 * own[0];
            assert!(colours.iter().all(is_blue), "{measure:?}");
        }
        assert!(Measure::Hair.colours(&rest, None).is_none());
        (0..30).try_for_each(|_| player.step().map(drop))?;
        let before = player.moment()?;
        player.step()?;
        let now = player.moment()?;
        let mean = |values: Vec<f32>| values.iter().sum::<f32>() / values.len() as f32;
        assert!(mean(displacements(&now)) > 0.003);
        assert!(mean(stretches(&now)) < 1e-4);
        let speed = mean(speeds(&now, Some(&before)));
        assert!((0.01..3.0).contains(&speed), "{speed}");
        // Roots do not move in the head.
        let first = now.groom().strand_offsets()[3] as usize;
        assert!(speeds(&now, Some(&before))[first] < 1e-3);
        assert!(mean(compressions(now.groom(), &in_head(&now).collect::<Vec<_>>())) > 0.01);
        // A frame long before, and one after it, tell no speed.
        assert_eq!(mean(speeds(&now, Some(&rest))), 0.0);
        assert_eq!(mean(speeds(&before, Some(&now))), 0.0);
        Ok(())
    }

    #[test]
    fn what_a_moment_does_not_tell_is_not_shown() -> Result<(), Box<dyn std::error::Error>> {
        let weak = ["solver.ams.non_hookean=true", "solver.ams.elastic_limit=0"];
        let sets = [&weak[..], &["groom.strands=400", "body.sdf_cells=32"]].concat();
        let sets = sets.into_iter().map(Override::set).collect::<Result<Vec<_>, _>>()?;
        let mut player = Player::builder(Scene::builtin(&sets)?).backend(Backend::Cpu).build()?;
        (0..30).try_for_each(|_| player.step().map(drop))?;
        let silent = player.moment()?;
        for measure in [Measure::Damage, Measure::Contacts] {
            assert!(!measure.is_told(&silent) && measure.colours(&silent, None).is_none());
            let moment = player.moment_with(measure.asks())?;
            assert!(measure.is_told(&moment));
            let colours = measure.colours(&moment, None).ok_or("colours")?;
            assert_eq!(colours.len(), moment.positions.len());
            // Roots are clamped: nothing weakens or moves them.
            assert_eq!(colours[moment.groom().strand_offsets()[3] as usize], colour(0.0));
            assert!(colours.iter().any(|own| *own != colour(0.0)), "{measure:?}");
        }
        let touches = player.moment_with(Measure::Contacts.asks())?.told.contacts.ok_or("contacts")?;
        let green = colour_of(TOUCHES[2].0);
        let colours = Measure::Contacts.colours(&player.moment_with(Measure::Contacts.asks())?, None);
        for (own, touch) in colours.ok_or("colours")?.iter().zip(&touches) {
            assert_eq!(*own == green, touch.solids && !touch.strands);
        }
        Ok(())
    }

    #[test]
    fn hair_that_is_pressed_together_is_denser() -> Result<(), Box<dyn std::error::Error>> {
        let strand = |s: u8| {
            let at = move |p: u8| Vec3::new(f32::from(s % 20), f32::from(s / 20), f32::from(p));
            (0..40).map(move |p| 0.002 * at(p) + 0.001).collect::<Vec<_>>()
        };
        let groom = Groom::from_strands((0..200).map(strand))?;
        let by = |factor: f32| groom.positions().iter().map(|x| *x * factor).collect::<Vec<_>>();
        assert!(compressions(&groom, &by(1.0)).iter().all(|own| *own == 0.0));
        assert!(compressions(&groom, &by(2.0)).iter().all(|own| *own == 0.0));
        // An eighth of the volume; at the rim cells are not full.
        let pressed = compressions(&groom, &by(0.5));
        let mean = pressed.iter().sum::<f32>() / pressed.len() as f32;
        assert!((5.5..8.0).contains(&mean), "{mean}");
        Ok(())
    }
}
