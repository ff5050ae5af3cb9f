//! The strands and motions of a training.

use std::collections::HashSet;

use forelock_core::body::{ClosedMesh, Sdf, TriMesh};
use forelock_core::groom::{Groom, GroomError};
use forelock_core::lane::Simd;
use forelock_neural::PARTICLES;
use forelock_neural::codes::encoder::{INPUTS, StrandCodes};
use forelock_neural::codes::{
    Encoder, LOCAL_SCALE_CM, LOCK_SIZE, Locks, crown_uv, encoder_inputs, static_inputs,
};
use forelock_neural::features::{Features, HeadMotion, SPACING_SECS};
use forelock_neural::losses::field::SmoothField;
use forelock_neural::model::{InputsError, strands_at_rest};
use forelock_neural::network::STATICS;
use forelock_neural::network::inference::Positions;
use forelock_neural::random::Random;
use forelock_neural::train::motions::{Kind, generate};
use forelock_neural::train::{Clip, STRANDS as SET_STRANDS, TrainingStrand, clip};
use forelock_neural::trial::Score;
use glam::{DVec3, Vec3};

use super::TrainingError;
use super::config::{TrainingConfig, is_preset};
use super::examination::KindScore;
use super::recorded::Recorded;
use crate::assets::Assets;
use crate::hash::Fnv;
use crate::neural::Scalp;
use crate::progress::{Observer, Progress};
use crate::scene::{Override, Scene};

/// Centimetres of a metre.
const CM: f64 = 100.0;
/// Distance of the nodes of the body's distance field, cm.
const SPACING_CM: f64 = 0.4;
/// How far that field reaches beyond the body, cm.
const BEYOND_CM: f64 = 5.0;
/// First seeds of the motions for each [`Use`], far apart from each other.
const SEEDS: [u64; 3] = [1_000, 900_000_000, 1_800_000_000];

/// Strands of one groom.
struct Kindred {
    rest: Vec<Positions>,
    uv: Vec<[f64; 2]>,
    local: Vec<[f32; INPUTS]>,
}

/// The hair of a training, before it has codes.
pub(super) struct Hair {
    pub field: SmoothField,
    pub names: Vec<String>,
    grooms: Vec<Kindred>,
    /// Of each groom the numbers of the strands for each [`Use`].
    lists: Vec<[Vec<usize>; 3]>,
}

/// What strands and motions are for.
#[derive(Clone, Copy)]
pub(super) enum Use {
    Training,
    /// They choose the best step.
    Choice,
    /// The result is measured with them.
    Measures,
}

/// Codes of strands.
pub(super) struct Codes {
    pub encoder: Encoder,
    /// σ_z.
    pub deviation: f32,
    /// RMS error a coordinate: of trained strands and of others, cm.
    pub errors: [f64; 2],
}

/// The numbers of a groom's strands for each [`Use`]: those that are held out, evenly over the
/// groom, and all others in the order of their locks.
fn split(groom: &Kindred, config: &TrainingConfig) -> Result<[Vec<usize>; 3], TrainingError> {
    let (count, held) = (groom.rest.len(), config.hair.held_out as usize);
    let at = |k: usize| k * count / (2 * held);
    let [choice, measured] = [0, 1].map(|first| (0..held).map(|k| at(2 * k + first)).collect::<Vec<_>>());
    let is_held: HashSet<usize> = choice.iter().chain(&measured).copied().collect();
    let locks = Locks::new(&groom.uv, LOCK_SIZE).map_err(TrainingError::Locks)?;
    let mut trained: Vec<usize> = (0..count).filter(|strand| !is_held.contains(strand)).collect();
    trained.sort_by_key(|strand| (locks.labels()[*strand], *strand));
    Ok([trained, choice, measured])
}

impl Hair {
    /// Grows or reads the hair of `config`.
    pub fn load(config: &TrainingConfig, observer: &mut Observer<'_>) -> Result<Self, TrainingError> {
        let (mut grooms, mut names) = (Vec::new(), Vec::new());
        let mut field = None;
        for name in &config.hair.grooms {
            let assets = Assets::load(&scene(config, name)?, observer)?;
            let mesh = assets.body_mesh().ok_or(TrainingError::NoBody)?;
            if field.is_none() {
                field = Some(distances(mesh)?);
            }
            let scalp = Scalp::new(Some(mesh));
            for share in &config.hair.lengths {
                let groom = cut(&assets.groom, *share).map_err(crate::assets::AssetError::from)?;
                grooms.push(kindred(name, &groom, &scalp, config)?);
                names.push(kind_name(name, *share));
            }
        }
        Ok(Self {
            field: field.ok_or(TrainingError::NoBody)?,
            names,
            lists: grooms.iter().map(|groom| split(groom, config)).collect::<Result<_, _>>()?,
            grooms,
        })
    }

    /// A hash of all strands at rest, 16 hexadecimal digits.
    pub fn digest(&self) -> String {
        let numbers = self.grooms.iter().flat_map(|groom| groom.rest.as_flattened().as_flattened());
        let hash = numbers.fold(Fnv::new(), |hash, x| hash.bytes(&x.to_le_bytes()));
        format!("{:016x}", hash.value())
    }

    /// Trains codes of the trained strands.
    pub fn codes(
        &self,
        config: &TrainingConfig,
        observer: &mut Observer<'_>,
    ) -> Result<Codes, TrainingError> {
        let of = |which: Use| -> Vec<[f32; INPUTS]> {
            let each = self.grooms.iter().zip(&self.lists);
            each.flat_map(|(groom, lists)| lists[which as usize].iter().map(|s| groom.local[*s])).collect()
        };
        let (own, other) = (of(Use::Training), [of(Use::Choice), of(Use::Measures)].concat());
        let total = u64::from(config.steps.codes);
        observer(&Progress::Begin { what: "training codes", done: 0, total });
        let codes = StrandCodes::train(&own, &config.code_options(), &mut || observer(&Progress::Step));
        observer(&Progress::End);
        let deviation = deviation(&codes, &own);
        if deviation.is_nan() || deviation < 1e-12 {
            return Err(TrainingError::AllAlike);
        }
        let errors = [&own, &other].map(|list| error(&codes, list));
        Ok(Codes { encoder: codes.encoder(), deviation, errors })
    }

    /// `scores`, one a groom, with the names of the grooms, to which `suffix` is added.
    pub fn named(&self, scores: Vec<Score>, suffix: &str) -> Vec<KindScore> {
        let named = self.names.iter().zip(scores);
        named.map(|(groom, score)| KindScore { groom: format!("{groom}{suffix}"), score }).collect()
    }

    /// The strands of each groom for a use, with their inputs, and how many each groom has.
    pub fn strands(
        &self,
        purpose: Use,
        encoder: &Encoder,
        deviation: f32,
    ) -> Result<(Vec<TrainingStrand>, Vec<usize>), TrainingError> {
        let (mut strands, mut counts) = (Vec::new(), Vec::new());
        for (groom, lists) in self.grooms.iter().zip(&self.lists) {
            let all = encoder.encode(&groom.local, Simd::Auto.resolve());
            let inputs = static_inputs(&groom.uv, &all, deviation).map_err(TrainingError::Locks)?;
            let strand = |s: &usize| TrainingStrand {
                rest: groom.rest[*s],
                statics: inputs[s * STATICS..][..STATICS].to_vec(),
            };
            let own = &lists[purpose as usize];
            strands.extend(own.iter().map(strand));
            counts.push(own.len());
        }
        Ok((strands, counts))
    }
}

/// The name of a preset, or of a file without its folder, with the share of its length.
fn kind_name(groom: &str, share: f64) -> String {
    let name = std::path::Path::new(groom).file_stem().unwrap_or_default().to_string_lossy();
    if share < 1.0 { format!("{name} x {share}") } else { name.into_owned() }
}

/// `groom` with each strand cut to a share of its length.
fn cut(groom: &Groom, share: f64) -> Result<Groom, GroomError> {
    if share >= 1.0 {
        return Ok(groom.clone());
    }
    let one = |strand: &[Vec3]| {
        let edges = || strand.windows(2).map(|x| f64::from(x[0].distance(x[1])));
        let mut left = share * edges().sum::<f64>();
        let mut own = vec![strand[0]];
        for (edge, ends) in edges().zip(strand.windows(2)) {
            let part = (left / edge.max(1e-12)).min(1.0);
            own.push(ends[0].lerp(ends[1], part as f32));
            left -= edge;
            if left <= 1e-9 {
                break;
            }
        }
        own
    };
    Groom::from_strands(groom.strands().map(one))
}

/// The scene of groom `name`.
fn scene(config: &TrainingConfig, name: &str) -> Result<Scene, TrainingError> {
    let own = |key: &str, value: &str| Override::option("hair.grooms", key, value);
    let mut overrides = vec![own("groom.vertices_per_strand", &PARTICLES.to_string())];
    if is_preset(name) {
        overrides.push(own("groom.source", "grow"));
        overrides.push(own("groom.preset", name));
        overrides.push(own("groom.strands", &config.hair.grown.to_string()));
    } else {
        overrides
            .push(own("groom.source", &std::path::absolute(name).unwrap_or(name.into()).to_string_lossy()));
    }
    let path = &config.hair.scene;
    Ok(if path.as_os_str().is_empty() { Scene::builtin(&overrides)? } else { Scene::load(path, &overrides)? })
}

/// The distance field of the body, cm.
fn distances(mesh: &TriMesh) -> Result<SmoothField, TrainingError> {
    let sdf = Sdf::near(&ClosedMesh::new(mesh), 128, 0.2, 0.002).map_err(TrainingError::Body)?;
    let corners = mesh.positions.iter().fold([Vec3::MAX, Vec3::MIN], |[a, b], x| [a.min(*x), b.max(*x)]);
    let [least, most] = corners.map(|x| CM * x.as_dvec3());
    let bounds = [least - BEYOND_CM, most + BEYOND_CM];
    Ok(SmoothField::new(bounds, SPACING_CM, |x| CM as f32 * sdf.sample((x / CM).as_vec3()).0))
}

/// The strands of `groom` as the network sees them.
fn kindred(
    name: &str,
    groom: &Groom,
    scalp: &Scalp,
    config: &TrainingConfig,
) -> Result<Kindred, TrainingError> {
    let needed = config.hair.held_out as usize * 2 + SET_STRANDS;
    if groom.strand_count() < needed {
        return Err(TrainingError::Few { groom: name.to_owned(), strands: groom.strand_count(), needed });
    }
    let strands = strands_at_rest(groom, DVec3::ZERO, &scalp.normals(groom, DVec3::ZERO))
        .map_err(crate::assets::AssetError::from)?;
    let distances_m = strands.iter().map(|strand| strand.direction.length() / CM);
    let distance_m = distances_m.sum::<f64>() / strands.len() as f64;
    if distance_m > crate::neural::FAR_M {
        return Err(TrainingError::Far { groom: name.to_owned(), distance_m });
    }
    let mut own = Kindred { rest: Vec::new(), uv: Vec::new(), local: Vec::new() };
    for (strand, at_rest) in strands.iter().enumerate() {
        let refused = |error| TrainingError::Strand {
            groom: name.to_owned(),
            error: InputsError::Strand { strand, error },
        };
        let x = at_rest.particles.map(|x| Vec3::from(x).as_dvec3());
        own.uv.push(crown_uv(at_rest.direction).map_err(refused)?);
        own.local.push(encoder_inputs(&x, at_rest.normal).map_err(refused)?);
        own.rest.push(at_rest.particles);
    }
    Ok(own)
}

/// The RMS error of `codes`, cm a coordinate.
fn error(codes: &StrandCodes, strands: &[[f32; INPUTS]]) -> f64 {
    let square = |x: &[f32; INPUTS]| {
        let found = codes.decode(&codes.encode(x));
        x.iter().zip(found).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / INPUTS as f64
    };
    LOCAL_SCALE_CM * (strands.iter().map(square).sum::<f64>() / strands.len().max(1) as f64).sqrt()
}

/// The mean of the deviations of each number of the codes of `strands`.
fn deviation(codes: &StrandCodes, strands: &[[f32; INPUTS]]) -> f32 {
    let all: Vec<_> = strands.iter().map(|strand| codes.encode(strand)).collect();
    let (count, numbers) = (all.len().max(1) as f64, all.first().map_or(0, |code| code.len()));
    let deviation = |k: usize| {
        let mean = all.iter().map(|code| f64::from(code[k])).sum::<f64>() / count;
        (all.iter().map(|code| (f64::from(code[k]) - mean).powi(2)).sum::<f64>() / count).sqrt()
    };
    ((0..numbers).map(deviation).sum::<f64>() / numbers.max(1) as f64) as f32
}

/// The features of a body whose head's origin is that of the head.
fn features() -> Result<Features, TrainingError> {
    Features::new(DVec3::ZERO, HeadMotion::default()).map_err(TrainingError::Motion)
}

/// What a trained motion is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Source {
    Recorded,
    Generated { kind: Kind, travels: bool },
}

/// What motion `number` is, if a share `recorded` of the motions is recorded. All kinds take turns
/// among the generated ones, and half of each kind travels.
fn source(number: u32, recorded: f64) -> Source {
    let before = |k: u32| (f64::from(k) * recorded).floor() as u32;
    if before(number + 1) > before(number) {
        return Source::Recorded;
    }
    let (kinds, own) = (Kind::ALL.len(), (number - before(number)) as usize);
    let (kind, round) = (own % kinds, own / kinds);
    Source::Generated { kind: Kind::ALL[kind], travels: (kind + round) % 2 == 1 }
}

/// The motions of `config` for a use: generated ones, and pieces of the `recorded` ones if they are
/// trained.
pub(super) fn motions(
    config: &TrainingConfig,
    recorded: &Recorded,
    purpose: Use,
) -> Result<Vec<Clip>, TrainingError> {
    let own = &config.motions;
    let is_trained = matches!(purpose, Use::Training);
    let count = if is_trained { own.count } else { own.held_out };
    let share = if is_trained && !recorded.is_empty() { own.recorded } else { 0.0 };
    let features = features()?;
    let first = SEEDS[purpose as usize] + 1_000_000 * (config.seed % 800);
    let one = |k: u32| {
        let seed = first + u64::from(k);
        let poses = match source(k, share) {
            Source::Recorded => {
                recorded.piece(config.frames(), &mut Random::stream(seed, Kind::ALL.len() as u64))
            }
            Source::Generated { kind, travels } => {
                generate(kind, travels, config.frames(), SPACING_SECS, seed)
            }
        };
        clip(&features, &poses).map_err(TrainingError::Motion)
    };
    (0..count).map(one).collect()
}

/// What the result is measured with of the `recorded` motions.
pub(super) fn recorded_motions(
    config: &TrainingConfig,
    recorded: &Recorded,
) -> Result<Vec<Clip>, TrainingError> {
    let features = features()?;
    let pieces = recorded.measured(config.frames(), config.motions.held_out as usize);
    pieces.iter().map(|poses| clip(&features, poses).map_err(TrainingError::Motion)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_kinds_take_turns_whatever_the_share_of_recorded_motions() {
        for share in [0.0, 0.25, 0.3, 0.5, 0.75] {
            let all: Vec<Source> = (0..4096).map(|k| source(k, share)).collect();
            let count = |wanted: Source| all.iter().filter(|own| **own == wanted).count() as f64 / 4096.0;
            assert!((count(Source::Recorded) - share).abs() < 1e-3, "{share}");
            for kind in Kind::ALL {
                for travels in [false, true] {
                    let found = count(Source::Generated { kind, travels });
                    assert!(
                        (found - (1.0 - share) / 8.0).abs() < 1e-3,
                        "{share}: {kind:?}, {travels}: {found}"
                    );
                }
            }
        }
    }
}
