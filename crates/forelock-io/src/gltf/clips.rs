//! Animations as clips.

use ::gltf::Document;
use ::gltf::animation::{Interpolation as Kind, Property};
use forelock_core::body::character::{Clip, Interpolation, Track, Values};
use glam::{DQuat, DVec3};

use super::Nodes;
use super::accessor::Buffers;

/// The clips of `document`; `notes` says what cannot be played.
pub fn read(
    document: &Document,
    nodes: &Nodes,
    buffers: &Buffers,
    notes: &mut Vec<String>,
) -> Result<Vec<Clip>, String> {
    let mut clips = Vec::new();
    let mut without_shapes = 0;
    for animation in document.animations() {
        let name = animation.name().map_or_else(|| format!("clip {}", animation.index()), str::to_owned);
        let mut tracks = Vec::new();
        for channel in animation.channels() {
            let (target, sampler) = (channel.target(), channel.sampler());
            let what = format!("animation {}, channel {}", animation.index(), channel.index());
            let node = target.node().index();
            let numbers = |width: usize| {
                let read = buffers.floats(&sampler.output(), width);
                read.map_err(|error| format!("{what}: {error}"))
            };
            let vectors = || -> Result<Vec<DVec3>, String> {
                let numbers = numbers(3)?;
                let vector = |v: &[f32; 3]| DVec3::from_array(v.map(f64::from));
                Ok(numbers.as_chunks().0.iter().map(vector).collect())
            };
            let values = match target.property() {
                Property::Translation => Values::Translation(vectors()?),
                Property::Scale => Values::Scale(vectors()?),
                Property::Rotation => {
                    let numbers = numbers(4)?;
                    let turn = |q: &[f32; 4]| DQuat::from_array(q.map(f64::from));
                    Values::Rotation(numbers.as_chunks().0.iter().map(turn).collect())
                }
                Property::MorphTargetWeights => {
                    let (first, count) = nodes.shapes_of[node];
                    if count == 0 {
                        without_shapes += 1;
                        continue;
                    }
                    let weights = numbers(1)?.into_iter().map(f64::from).collect();
                    Values::Shapes { first, count, weights }
                }
            };
            let times = buffers.floats(&sampler.input(), 1);
            let times = times.map_err(|error| format!("{what}: {error}"))?;
            let mut track = Track {
                joint: nodes.joint_of[node],
                times: times.into_iter().map(f64::from).collect(),
                interpolation: match sampler.interpolation() {
                    Kind::Step => Interpolation::Step,
                    Kind::Linear => Interpolation::Linear,
                    Kind::CubicSpline => Interpolation::Cubic,
                },
                values,
            };
            track.check().map_err(|error| format!("{what} ({name}): {error}"))?;
            tracks.push(track);
        }
        clips.push(Clip { name, tracks });
    }
    if without_shapes > 0 {
        notes.push(format!("{without_shapes} tracks of blend shapes drive a mesh that has none"));
    }
    Ok(clips)
}
