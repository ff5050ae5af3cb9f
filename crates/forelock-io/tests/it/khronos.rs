//! Characters and motions that other programs wrote, against the formulas of the glTF 2.0
//! specification in float64, applied to the numbers of the file by code of this test alone.

#![expect(clippy::unwrap_used, clippy::panic, reason = "a helper of tests fails by panicking")]

use std::path::{Path, PathBuf};
use std::sync::Arc;

use forelock_core::body::character::{Performance, Playback, PosingBuffers, Skinning};
use forelock_core::groom::Import;
use forelock_io::{bvh, read_character, read_motion};
use glam::{DMat4, DQuat, DVec3, DVec4};
use serde_json::Value;

use crate::characters::same_motion;

fn data(name: &str) -> PathBuf {
    Path::new(option_env!("REAL_DATA").unwrap_or_default()).join(name)
}

/// The JSON and the binary chunk of a `.glb`.
struct Glb {
    json: Value,
    bytes: Vec<u8>,
}

fn index(value: &Value) -> usize {
    value.as_u64().unwrap() as usize
}

impl Glb {
    fn open(name: &str) -> Self {
        let file = std::fs::read(data(name)).unwrap();
        let length = u32::from_le_bytes(file[12..16].try_into().unwrap()) as usize;
        let json = serde_json::from_slice(&file[20..20 + length]).unwrap();
        Self { json, bytes: file[28 + length..].to_vec() }
    }

    /// The entries of an accessor as they are stored.
    fn entries(&self, accessor: usize) -> Vec<Vec<f64>> {
        let own = &self.json["accessors"][accessor];
        let view = &self.json["bufferViews"][index(&own["bufferView"])];
        let offset = |value: &Value| value["byteOffset"].as_u64().unwrap_or(0) as usize;
        let width = match own["type"].as_str().unwrap() {
            "SCALAR" => 1,
            "VEC3" => 3,
            "VEC4" => 4,
            "MAT4" => 16,
            other => panic!("{other}"),
        };
        let kind = own["componentType"].as_u64().unwrap();
        let size = [1, 1, 2, 2, 4, 4, 4][kind as usize - 5120];
        let stride = view["byteStride"].as_u64().map_or(width * size, |stride| stride as usize);
        let first = offset(own) + offset(view);
        let number = |at: usize| match kind {
            5121 => f64::from(self.bytes[at]),
            5123 => f64::from(u16::from_le_bytes(self.bytes[at..at + 2].try_into().unwrap())),
            5126 => f64::from(f32::from_le_bytes(self.bytes[at..at + 4].try_into().unwrap())),
            other => panic!("{other}"),
        };
        let entry = |i: usize| (0..width).map(|c| number(first + i * stride + c * size)).collect();
        (0..index(&own["count"])).map(entry).collect()
    }

    /// A node's translation, rotation and scale, or its matrix, by the names of their properties.
    fn local(&self, node: usize, animated: &[(usize, String, Vec<f64>)]) -> DMat4 {
        let own = &self.json["nodes"][node];
        let numbers = |value: &Value| -> Option<Vec<f64>> {
            Some(value.as_array()?.iter().map(|x| x.as_f64().unwrap()).collect())
        };
        if let Some(matrix) = numbers(&own["matrix"]) {
            return DMat4::from_cols_array(&matrix.try_into().unwrap());
        }
        let of = |name: &str, default: &[f64]| {
            let moved = animated.iter().find(|own| own.0 == node && own.1 == name).map(|own| own.2.clone());
            moved.or_else(|| numbers(&own[name])).unwrap_or_else(|| default.to_vec())
        };
        DMat4::from_scale_rotation_translation(
            DVec3::from_slice(&of("scale", &[1.0; 3])),
            DQuat::from_slice(&of("rotation", &[0.0, 0.0, 0.0, 1.0])).normalize(),
            DVec3::from_slice(&of("translation", &[0.0; 3])),
        )
    }

    /// The values of all channels of an animation at `secs`.
    fn animated(&self, animation: &Value, secs: f64) -> Vec<(usize, String, Vec<f64>)> {
        let channels = animation["channels"].as_array().unwrap();
        let value = |channel: &Value| {
            let sampler = &animation["samplers"][index(&channel["sampler"])];
            let times: Vec<f64> = self.entries(index(&sampler["input"])).concat();
            let values = self.entries(index(&sampler["output"]));
            let path = channel["target"]["path"].as_str().unwrap().to_owned();
            let last = times.len() - 1;
            let secs = secs.clamp(times[0], times[last]);
            let key = times.windows(2).position(|pair| secs <= pair[1]).unwrap_or(0);
            let share = if last == 0 { 0.0 } else { (secs - times[key]) / (times[key + 1] - times[key]) };
            let (a, b) = (&values[key], &values[last.min(key + 1)]);
            let value = if path == "rotation" {
                let (a, b) = (DQuat::from_slice(a).normalize(), DQuat::from_slice(b).normalize());
                a.slerp(b, share).to_array().to_vec()
            } else {
                a.iter().zip(b).map(|(a, b)| a + (b - a) * share).collect()
            };
            (index(&channel["target"]["node"]), path, value)
        };
        channels.iter().map(value).collect()
    }

    /// The vertices of the only mesh at `secs` of an animation.
    fn skinned(&self, animation: &Value, secs: f64) -> Vec<DVec3> {
        let animated = self.animated(animation, secs);
        let nodes = self.json["nodes"].as_array().unwrap();
        let mut parents = vec![None; nodes.len()];
        for (node, own) in nodes.iter().enumerate() {
            for child in own["children"].as_array().into_iter().flatten() {
                parents[index(child)] = Some(node);
            }
        }
        let global = |node: usize| {
            let (mut matrix, mut at) = (self.local(node, &animated), parents[node]);
            while let Some(parent) = at {
                (matrix, at) = (self.local(parent, &animated) * matrix, parents[parent]);
            }
            matrix
        };
        let skin = &self.json["skins"][0];
        let joints: Vec<usize> = skin["joints"].as_array().unwrap().iter().map(index).collect();
        let binds = self.entries(index(&skin["inverseBindMatrices"]));
        let bind = |own: &Vec<f64>| DMat4::from_cols_array(&own.clone().try_into().unwrap());
        let matrices: Vec<DMat4> =
            joints.iter().zip(&binds).map(|(&joint, own)| global(joint) * bind(own)).collect();
        let attributes = &self.json["meshes"][0]["primitives"][0]["attributes"];
        let of = |name: &str| self.entries(index(&attributes[name]));
        let (positions, joints, weights) = (of("POSITION"), of("JOINTS_0"), of("WEIGHTS_0"));
        let vertex = |i: usize| {
            let p = DVec3::from_slice(&positions[i]).extend(1.0);
            let sum: f64 = weights[i].iter().sum();
            let own = joints[i].iter().zip(&weights[i]);
            own.map(|(&joint, weight)| matrices[joint as usize] * p * (weight / sum))
                .sum::<DVec4>()
                .truncate()
        };
        (0..positions.len()).map(vertex).collect()
    }
}

#[test]
#[cfg_attr(not(real_data), ignore = "no real data: set FORELOCK_DATA to its folder")]
fn every_clip_is_skinned_as_the_specification_says() {
    // Metres; the fox is 100 units long.
    for (name, scale, clips) in [("CesiumMan", 1.0, 1), ("Fox", 0.01, 3)] {
        let glb = Glb::open(&format!("skinned/{name}.glb"));
        let import = Import { scale, ..Import::default() };
        let own = read_character(&data(&format!("skinned/{name}.glb")), &import).unwrap();
        assert_eq!(own.notes, [""; 0], "{name}");
        let own = Arc::new(own.character);
        assert_eq!(own.clips().len(), clips);
        let playback = Playback { blend_secs: 0.0, repeats: false, ..Playback::default() };
        for (clip, animation) in own.clips().iter().zip(glb.json["animations"].as_array().unwrap()) {
            let duration = clip.duration_secs();
            assert!(duration > 0.5);
            // A joint that carries nothing: positions are in the body's space, but for its motion.
            let act = Performance::new(own.clone(), clip.clone(), playback, Skinning::Linear, 0).unwrap();
            let mut buffers = PosingBuffers::default();
            let mut moved = 0.0f64;
            for step in 0..=6 {
                let secs = duration * f64::from(step) / 6.0;
                let expected = glb.skinned(animation, secs);
                let posed = act.posed(secs, &mut buffers);
                let found: Vec<DVec3> =
                    posed.positions.iter().map(|p| posed.carrier.transform_point(p.as_dvec3())).collect();
                for p in &expected {
                    let p = *p * scale;
                    let nearest = found.iter().map(|q| q.distance(p)).fold(f64::INFINITY, f64::min);
                    assert!(nearest <= 1e-6, "{name} {}, {secs} s: {nearest}", clip.name);
                }
                let rest = own.rest().positions.iter().map(|p| p.as_dvec3());
                moved = rest.zip(&found).map(|(a, b)| a.distance(*b)).fold(moved, f64::max);
            }
            assert!(moved > 0.05, "{name} {} stands still: {moved}", clip.name);
        }
    }
}

#[test]
#[cfg_attr(not(real_data), ignore = "no real data: set FORELOCK_DATA to its folder")]
fn motions_of_other_programs_survive_being_written() {
    for (name, frames, joints) in [("01_01", 2752, 31), ("scaled_131_01", 995, 31)] {
        let own = read_motion(&data(&format!("motion/{name}.bvh"))).unwrap();
        let named = own.skeleton.joints().iter().filter(|joint| !joint.name.ends_with(" end")).count();
        assert_eq!((own.frames, named), (frames, joints));
        let back = bvh::read(&bvh::write(&own.skeleton, &own.clip, own.frames, own.frame_secs)).unwrap();
        let difference = same_motion(&own, &back);
        assert!(difference < 1e-6, "{name}: {difference}");
    }
}
