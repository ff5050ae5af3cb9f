//! Trains the network for hair of the built-in head and measures it, on motions and strands that it
//! was not trained on, against the implicit reference.
//!
//! `cargo run --release -p forelock-neural --example train_head -- [STEPS] [SEED]`

#![expect(clippy::print_stdout, reason = "its results")]

use forelock_core::body::{ClosedMesh, Head, Sdf};
use forelock_core::groom::grow::{GrowParams, grow_on_head};
use forelock_core::groom::resample;
use forelock_core::lane::{Mat3, Simd, V3};
use forelock_neural::PARTICLES;
use forelock_neural::codes::encoder::{CODE, CodeOptions, INPUTS, StrandCodes};
use forelock_neural::codes::{LOCAL_SCALE_CM, crown_uv, encoder_inputs, static_inputs};
use forelock_neural::features::{BodyPose, Features, HeadMotion, SPACING_SECS};
use forelock_neural::losses::Strand;
use forelock_neural::losses::body::{Body, Near};
use forelock_neural::losses::motion::Place;
use forelock_neural::measures::Motions;
use forelock_neural::network::STATICS;
use forelock_neural::network::inference::{Positions, Predictor};
use forelock_neural::reference::{Terms, motion};
use forelock_neural::train::motions::{Kind, generate};
use forelock_neural::train::{Clip, Field, Frame, Options, Trainer, TrainingSet, TrainingStrand};
use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;
use std::error::Error;
use std::sync::Arc;
use std::time::Instant;

const STYLES: [&str; 4] = ["straight", "wavy", "curly", "bob"];
/// Frames of a motion.
const FRAMES: usize = 150;

/// The built-in head, in cm.
#[derive(Clone, Debug)]
struct HeadField(Arc<Sdf>);

impl Field for HeadField {
    fn near(&self, x: [f32; 3]) -> (f32, [f32; 3]) {
        let (distance, gradient) = self.0.sample(Vec3::from(x) * 0.01);
        (100.0 * distance, gradient.to_array())
    }
}

impl Body<f64> for HeadField {
    fn near(&self, x: V3<f64>) -> Near<f64> {
        let (distance, gradient) = Field::near(self, x.0.map(|c| c as f32));
        Near { distance: distance.into(), gradient: V3(gradient.map(f64::from)) }
    }
}

/// Strands of all styles, `count` each: positions, uv, inputs of the encoder.
struct Hair {
    rest: Vec<Positions>,
    uv: Vec<[f64; 2]>,
    local: Vec<[f32; INPUTS]>,
}

fn grow(count: u32, seed: u64, field: &HeadField) -> Result<Hair, Box<dyn Error>> {
    let mut hair = Hair { rest: Vec::new(), uv: Vec::new(), local: Vec::new() };
    for style in STYLES {
        let params = GrowParams { strands: count, seed, ..GrowParams::preset(style)? };
        let groom = resample(&grow_on_head(&params)?, PARTICLES)?;
        for strand in groom.strands() {
            let x: Vec<DVec3> = strand.iter().map(|x| 100.0 * x.as_dvec3()).collect();
            let (_, normal) = Field::near(field, x[0].as_vec3().to_array());
            hair.uv.push(crown_uv(x[0])?);
            hair.local.push(encoder_inputs(&x, Vec3::from(normal).as_dvec3())?);
            hair.rest.push(std::array::from_fn(|i| x[i].as_vec3().to_array()));
        }
    }
    Ok(hair)
}

/// The inputs of each strand; codes are divided by `deviation`.
fn statics(hair: &Hair, codes: &[[f32; CODE]], deviation: f32) -> Result<Vec<Vec<f32>>, Box<dyn Error>> {
    // Locks are those of a groom: strands of a style follow each other.
    let size = hair.uv.len() / STYLES.len();
    let mut all = Vec::new();
    for (uv, codes) in hair.uv.chunks(size).zip(codes.chunks(size)) {
        let inputs = static_inputs(uv, codes.as_flattened(), deviation)?;
        all.extend(inputs.chunks_exact(STATICS).map(<[f32]>::to_vec));
    }
    Ok(all)
}

fn clip(poses: &[BodyPose]) -> Result<Clip, Box<dyn Error>> {
    let features = Features::new(DVec3::ZERO, HeadMotion::Velocity)?.motion(poses)?;
    let frame = |(number, pose): (usize, &BodyPose)| {
        let shared = features.shared(number, &[0.0; 10]).map(|x| x.iter().map(|x| *x as f32).collect());
        let rotation = DMat3::from_quat(pose.head.rotation);
        Frame {
            rotation,
            origin: pose.head.translation,
            shared: shared.unwrap_or_default(),
            parts: Vec::new(),
        }
    };
    Ok(poses.iter().enumerate().map(frame).collect())
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<u64> = std::env::args().skip(1).map(|a| a.parse()).collect::<Result<_, _>>()?;
    let steps = arguments.first().copied().unwrap_or(12_000) as u32;
    let seed = arguments.get(1).copied().unwrap_or(1);
    let began = Instant::now();
    let say = |what: &str| println!("{:7.1} s  {what}", began.elapsed().as_secs_f64());
    let field = HeadField(Arc::new(Sdf::near(&ClosedMesh::new(&Head::builtin().mesh), 128, 0.2, 0.002)?));
    let [hair, held_out] = [(512, 1), (8, 77)].map(|(count, seed)| grow(count, seed, &field));
    let (hair, held_out) = (hair?, held_out?);
    let encoder = StrandCodes::train(&hair.local, &CodeOptions { seed, ..CodeOptions::default() });
    let rms = |hair: &Hair| {
        let square = |x: &[f32; INPUTS]| {
            let found = encoder.decode(&encoder.encode(x));
            x.iter().zip(found).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / INPUTS as f64
        };
        LOCAL_SCALE_CM * (hair.local.iter().map(square).sum::<f64>() / hair.local.len() as f64).sqrt()
    };
    say(&format!("codes: {:.3} cm RMS a coordinate, {:.3} held out", rms(&hair), rms(&held_out)));
    let codes = |hair: &Hair| hair.local.iter().map(|x| encoder.encode(x)).collect::<Vec<_>>();
    let own = codes(&hair);
    let deviation = mean_deviation(&own);
    let inputs = statics(&hair, &own, deviation)?;
    let strands = hair.rest.iter().zip(inputs).map(|(rest, statics)| TrainingStrand { rest: *rest, statics });
    let motions = |count: u64, seed: u64| -> Vec<(Kind, Vec<BodyPose>)> {
        let one = |k: u64| {
            let kind = Kind::ALL[k as usize % 4];
            (kind, generate(kind, FRAMES, SPACING_SECS, seed + k))
        };
        (0..count).map(one).collect()
    };
    let clips = motions(128, 1000).iter().map(|(_, poses)| clip(poses)).collect::<Result<_, _>>()?;
    let set = TrainingSet::new(strands.collect(), clips, Box::new(field.clone()))?;

    let options = Options { seed, steps, ..Options::default() };
    let terms = Terms {
        elastic: options.energies.elastic,
        motion: options.energies.motion,
        body: options.energies.body,
    };
    let validation = motions(4, 900_000);
    let held_statics = statics(&held_out, &codes(&held_out), deviation)?.concat();
    let to_f64 = |x: &Positions| -> Strand<f64> { std::array::from_fn(|i| V3(x[i].map(f64::from))) };
    let references: Vec<Vec<Vec<Strand<f64>>>> = validation
        .iter()
        .map(|(_, poses)| {
            let place = |pose: &BodyPose| Place {
                rotation: Mat3::splat(DMat3::from_quat(pose.head.rotation)),
                origin: V3::splat(pose.head.translation),
            };
            let places: Vec<Place<f64>> = poses.iter().map(place).collect();
            let bodies = vec![field.clone(); poses.len()];
            held_out.rest.par_iter().map(|rest| motion(&terms, &to_f64(rest), &places, &bodies)).collect()
        })
        .collect();
    say("references");

    let mut trainer = Trainer::new(options);
    while trainer.done() < steps {
        let mut sum = 0.0;
        for _ in 0..1000 {
            sum += trainer.step(&set).energy;
        }
        say(&format!("step {}, energy {:.3}", trainer.done(), sum / 1000.0));
        if trainer.done() % 4000 != 0 && trainer.done() < steps {
            continue;
        }
        let predictor = Predictor::new(trainer.network(), trainer.basis(), Simd::Auto)?;
        let prepared = predictor.prepare(&held_out.rest, &held_statics)?;
        for ((kind, poses), reference) in validation.iter().zip(&references) {
            let clip = clip(poses)?;
            let mut found = vec![vec![[[0.0; 3]; PARTICLES]; held_out.rest.len()]; poses.len()];
            for (frame, found) in clip.iter().zip(&mut found) {
                predictor.predict(&prepared, &frame.shared, found);
            }
            report(*kind, &held_out, &found, reference, &field)?;
        }
    }
    Ok(())
}

/// The mean of the deviations of each number of codes.
fn mean_deviation(codes: &[[f32; CODE]]) -> f32 {
    let count = codes.len() as f64;
    let deviation = |k: usize| {
        let mean = codes.iter().map(|code| f64::from(code[k])).sum::<f64>() / count;
        (codes.iter().map(|code| (f64::from(code[k]) - mean).powi(2)).sum::<f64>() / count).sqrt()
    };
    ((0..CODE).map(deviation).sum::<f64>() / CODE as f64) as f32
}

/// Prints the measures of each style.
fn report(
    kind: Kind,
    hair: &Hair,
    found: &[Vec<Positions>],
    reference: &[Vec<Strand<f64>>],
    field: &HeadField,
) -> Result<(), Box<dyn Error>> {
    let size = hair.rest.len() / STYLES.len();
    for (style, name) in STYLES.iter().enumerate() {
        let own = style * size..(style + 1) * size;
        let rest: Vec<[f64; 3]> = hair.rest[own.clone()].iter().flatten().map(|x| x.map(f64::from)).collect();
        let moved: Vec<[f64; 3]> = found
            .iter()
            .flat_map(|frame| frame[own.clone()].iter().flatten().map(|x| x.map(f64::from)))
            .collect();
        let expected: Vec<[f64; 3]> = (0..found.len())
            .flat_map(|frame| own.clone().flat_map(move |s| reference[s][frame].map(|x| x.0)))
            .collect();
        let inside = moved.iter().filter(|x| Field::near(field, x.map(|c| c as f32)).0 < -0.1).count();
        let motions = Motions { particles: PARTICLES, rest: &rest, motion: &moved, reference: &expected };
        let m = motions.measure()?;
        println!(
            "  {:18} {name:9} corr {:.2} vel {:.2} nrmse {:.2} dyn {:.2} ratio {:.2} inside {:.3} %",
            format!("{kind:?}"),
            m.corr,
            m.corr_vel,
            m.nrmse,
            m.nrmse_dyn,
            m.motion_ratio,
            100.0 * inside as f64 / moved.len() as f64
        );
    }
    Ok(())
}
