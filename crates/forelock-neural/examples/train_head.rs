//! Trains the network for hair of the built-in head and measures it, on motions and strands that it
//! was not trained on, against the implicit reference.
//!
//! `cargo run --release -p forelock-neural --example train_head -- STEPS SEED MOTIONS STRANDS`
//! (strands of each style; every argument has a default)

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
use forelock_neural::losses::field::SmoothField;
use forelock_neural::losses::motion::Place;
use forelock_neural::measures::Motions;
use forelock_neural::network::STATICS;
use forelock_neural::network::inference::{Positions, Predictor};
use forelock_neural::reference::{Terms, motion};
use forelock_neural::train::motions::{Kind, generate};
use forelock_neural::train::{Clip, Frame, Options, Trainer, TrainingSet, TrainingStrand, shared};
use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;
use std::error::Error;
use std::time::Instant;

const STYLES: [&str; 4] = ["straight", "wavy", "curly", "bob"];
/// Frames of a motion.
const FRAMES: usize = 150;

/// The built-in head, in cm.
fn head() -> Result<SmoothField, Box<dyn Error>> {
    let mesh = &Head::builtin().mesh;
    let sdf = Sdf::near(&ClosedMesh::new(mesh), 128, 0.2, 0.002)?;
    let corners = mesh.positions.iter().fold([Vec3::MAX, Vec3::MIN], |[a, b], x| [a.min(*x), b.max(*x)]);
    let [least, most] = corners.map(|x| 100.0 * x.as_dvec3());
    let bounds = [least - 5.0, most + 5.0];
    Ok(SmoothField::new(bounds, 0.4, |x| 100.0 * sdf.sample((0.01 * x).as_vec3()).0))
}

/// Strands of all styles, `count` each: positions, uv, inputs of the encoder.
struct Hair {
    rest: Vec<Positions>,
    uv: Vec<[f64; 2]>,
    local: Vec<[f32; INPUTS]>,
}

impl Hair {
    fn only(&self, kept: &[usize]) -> Self {
        Self {
            rest: kept.iter().map(|s| self.rest[*s]).collect(),
            uv: kept.iter().map(|s| self.uv[*s]).collect(),
            local: kept.iter().map(|s| self.local[*s]).collect(),
        }
    }
}

fn grow(count: u32, seed: u64, field: &SmoothField) -> Result<Hair, Box<dyn Error>> {
    let mut hair = Hair { rest: Vec::new(), uv: Vec::new(), local: Vec::new() };
    for style in STYLES {
        let params = GrowParams { strands: count, seed, ..GrowParams::preset(style)? };
        let groom = resample(&grow_on_head(&params)?, PARTICLES)?;
        for strand in groom.strands() {
            let x: Vec<DVec3> = strand.iter().map(|x| 100.0 * x.as_dvec3()).collect();
            let (_, normal) = field.sample(x[0].to_array());
            hair.uv.push(crown_uv(x[0])?);
            hair.local.push(encoder_inputs(&x, DVec3::from(normal))?);
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
    let numbers = features.pose.iter().zip(&features.velocity);
    let frame = |(body, (pose, velocity)): (&BodyPose, (&[f64; 24], &[f64; 24]))| {
        let mut inputs = [0.0; 34];
        inputs.iter_mut().zip(pose).for_each(|(to, x)| *to = *x as f32);
        Frame {
            rotation: DMat3::from_quat(body.head.rotation),
            origin: body.head.translation,
            pose: inputs,
            velocity: velocity.map(|x| x as f32),
            parts: Vec::new(),
        }
    };
    Ok(poses.iter().zip(numbers).map(frame).collect())
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<u64> = std::env::args().skip(1).map(|a| a.parse()).collect::<Result<_, _>>()?;
    let steps = arguments.first().copied().unwrap_or(12_000) as u32;
    let seed = arguments.get(1).copied().unwrap_or(1);
    let began = Instant::now();
    let say = |what: &str| println!("{:7.1} s  {what}", began.elapsed().as_secs_f64());
    let field = head()?;
    let count = arguments.get(3).copied().unwrap_or(512) as usize;
    let all = grow(count as u32, 1, &field)?;
    // Eight strands of each style are held out; their locks are those of the whole groom.
    let is_held_out = |s: usize| s.is_multiple_of(count.div_ceil(8));
    let (held, own): (Vec<usize>, Vec<usize>) = (0..all.rest.len()).partition(|s| is_held_out(s % count));
    let [hair, held_out] = [&own, &held].map(|kept| all.only(kept));
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
    let deviation = mean_deviation(&codes(&hair));
    let inputs = statics(&all, &codes(&all), deviation)?;
    let strands = own.iter().map(|s| TrainingStrand { rest: all.rest[*s], statics: inputs[*s].clone() });
    let motions = |count: u64, seed: u64| -> Vec<(Kind, Vec<BodyPose>)> {
        let one = |k: u64| {
            let kind = Kind::ALL[k as usize % 4];
            (kind, generate(kind, FRAMES, SPACING_SECS, seed + k))
        };
        (0..count).map(one).collect()
    };
    let clips = motions(arguments.get(2).copied().unwrap_or(1024), 1000)
        .iter()
        .map(|(_, poses)| clip(poses))
        .collect::<Result<_, _>>()?;
    let set = TrainingSet::new(strands.collect(), clips, field.clone())?;

    let options = Options { seed, steps, ..Options::default() };
    let terms = Terms {
        elastic: options.energies.elastic,
        motion: options.energies.motion,
        body: options.energies.body,
    };
    let validation = motions(4, 900_000);
    let held_statics: Vec<f32> = held.iter().flat_map(|s| inputs[*s].iter().copied()).collect();
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
            sum += trainer.step(&set)?.energy;
        }
        say(&format!("step {}, energy {:.3}", trainer.done(), sum / 1000.0));
        if !trainer.done().is_multiple_of(2000) && trainer.done() < steps {
            continue;
        }
        let predictor = Predictor::new(trainer.average(), trainer.basis(), Simd::Auto)?;
        let prepared = predictor.prepare(&held_out.rest, &held_statics)?;
        let mut sums = [[0.0; 6]; 4];
        for ((kind, poses), reference) in validation.iter().zip(&references) {
            let clip = clip(poses)?;
            let mut found = vec![vec![[[0.0; 3]; PARTICLES]; held_out.rest.len()]; poses.len()];
            for (frame, found) in found.iter_mut().enumerate() {
                predictor.predict(&prepared, &shared(&clip, frame).collect::<Vec<f32>>(), found);
            }
            report(*kind, &held_out, &found, reference, &field, &mut sums)?;
        }
        for (sum, style) in sums.iter().zip(STYLES) {
            let mean = sum.map(|x| x / 4.0);
            println!(
                "    {style:9} corr {:.3} vel {:.3} nrmse {:.3} dyn {:.3} ratio {:.3} inside {:.2}",
                mean[0], mean[1], mean[2], mean[3], mean[4], mean[5]
            );
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
    field: &SmoothField,
    sums: &mut [[f64; 6]; 4],
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
        let inside = |x: &[[f64; 3]]| {
            100.0 * x.iter().filter(|x| field.sample(**x).0 < -0.1).count() as f64 / x.len() as f64
        };
        let motions = Motions { particles: PARTICLES, rest: &rest, motion: &moved, reference: &expected };
        let m = motions.measure()?;
        let numbers = [m.corr, m.corr_vel, m.nrmse, m.nrmse_dyn, m.motion_ratio, inside(&moved)];
        sums[style].iter_mut().zip(numbers).for_each(|(sum, x)| *sum += x);
        println!(
            "  {:16} {name:9} corr {:.2} vel {:.2} nrmse {:.2} dyn {:.2} ratio {:.2} of {:.2} and {:.2} cm, \
             inside {:.2} %, at rest {:.2}, reference {:.2}",
            format!("{kind:?}"),
            m.corr,
            m.corr_vel,
            m.nrmse,
            m.nrmse_dyn,
            m.motion_ratio,
            m.ref_rms,
            m.ref_dyn,
            inside(&moved),
            inside(&rest),
            inside(&expected)
        );
    }
    Ok(())
}
