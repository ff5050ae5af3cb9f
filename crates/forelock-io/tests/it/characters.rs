//! Characters and motions: what files of our own mean, and a hundred broken variants of them.

#![expect(clippy::unwrap_used, reason = "a helper of tests fails by panicking")]

use std::path::Path;

use base64::Engine as _;
use forelock_core::body::character::{Interpolation, SkinPose, Skinning};
use forelock_core::groom::{Import, Unit, Up};
use forelock_io::{bvh, gltf, read_character};
use glam::{DVec3, Vec3};
use proptest::prelude::*;
use serde_json::{Value, json};

/// A file of its own: a square that follows two joints, with a blend shape and two clips.
struct Example {
    json: Value,
    bytes: Vec<u8>,
}

impl Example {
    fn new() -> Self {
        let mut own = Self { json: Value::Null, bytes: Vec::new() };
        let positions = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 2.0, 0.0, 0.0, 2.0, 0.0];
        let mut accessors = vec![
            own.floats("VEC3", 4, &positions),
            own.bytes(5121, "VEC4", 4, &[0, 1, 0, 0, 0, 1, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0]),
        ];
        let weights: Vec<f32> = [[0.5, 0.5, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]]
            .iter()
            .flat_map(|w| [w, w])
            .flatten()
            .copied()
            .collect();
        accessors.push(own.floats("VEC4", 4, &weights));
        accessors.push(own.bytes(5123, "SCALAR", 6, &[0, 0, 1, 0, 2, 0, 0, 0, 2, 0, 3, 0]));
        let mut binds = [0.0f32; 32];
        for i in 0..4 {
            (binds[5 * i], binds[16 + 5 * i]) = (1.0, 1.0);
        }
        binds[16 + 13] = -1.0;
        accessors.push(own.floats("MAT4", 2, &binds));
        accessors.push(own.floats("VEC3", 4, &[0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]));
        accessors.push(own.floats("SCALAR", 2, &[0.0, 1.0]));
        let half = 0.5f32.sqrt();
        accessors.push(own.floats("VEC4", 2, &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, half, half]));
        accessors.push(own.floats("SCALAR", 6, &[0.0, 0.0, 1.0, 1.0, 2.0, 0.0]));
        (accessors[0]["min"], accessors[0]["max"]) = (json!([0.0, 0.0, 0.0]), json!([1.0, 2.0, 0.0]));
        let views: Vec<Value> = accessors.iter().map(|own| own["view"].clone()).collect();
        let accessors: Vec<Value> = accessors
            .into_iter()
            .enumerate()
            .map(|(i, mut own)| {
                own["bufferView"] = i.into();
                own.as_object_mut().unwrap().remove("view");
                own
            })
            .collect();
        own.json = json!({
            "asset": { "version": "2.0" },
            "scene": 0,
            "scenes": [{ "nodes": [0, 2] }],
            "nodes": [
                { "name": "Root", "children": [1] },
                { "name": "Head", "translation": [0.0, 1.0, 0.0] },
                { "name": "Body", "mesh": 0, "skin": 0 },
            ],
            "meshes": [{
                "name": "Square",
                "weights": [0.0],
                "extras": { "targetNames": ["bulge"] },
                "primitives": [{
                    "attributes": { "POSITION": 0, "JOINTS_0": 1, "WEIGHTS_0": 2 },
                    "indices": 3,
                    "targets": [{ "POSITION": 5 }],
                }],
            }],
            "skins": [{ "joints": [0, 1], "inverseBindMatrices": 4 }],
            "animations": [
                {
                    "name": "nod",
                    "channels": [{ "sampler": 0, "target": { "node": 1, "path": "rotation" } }],
                    "samplers": [{ "input": 6, "output": 7 }],
                },
                {
                    "channels": [{ "sampler": 0, "target": { "node": 2, "path": "weights" } }],
                    "samplers": [{ "input": 6, "output": 8, "interpolation": "CUBICSPLINE" }],
                },
            ],
            "accessors": accessors,
            "bufferViews": views,
            "buffers": [],
        });
        own
    }

    fn floats(&mut self, kind: &str, count: usize, numbers: &[f32]) -> Value {
        let bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
        self.bytes(5126, kind, count, &bytes)
    }

    fn bytes(&mut self, component: u32, kind: &str, count: usize, bytes: &[u8]) -> Value {
        let (offset, length) = (self.bytes.len(), bytes.len());
        self.bytes.extend(bytes);
        let padded = self.bytes.len().next_multiple_of(4);
        self.bytes.resize(padded, 0);
        let view = json!({ "buffer": 0, "byteOffset": offset, "byteLength": length });
        json!({ "componentType": component, "type": kind, "count": count, "view": view })
    }

    /// As a `.glb`.
    fn glb(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        if json["buffers"] == json!([]) {
            json["buffers"] = json!([{ "byteLength": self.bytes.len() }]);
        }
        let mut text = json.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let length = 12 + 8 + text.len() + 8 + self.bytes.len();
        let word = |x: usize| u32::try_from(x).unwrap().to_le_bytes();
        let mut file = b"glTF".to_vec();
        file.extend([word(2), word(length), word(text.len()), *b"JSON"].concat());
        file.extend(text);
        file.extend([word(self.bytes.len()), *b"BIN\0"].concat());
        file.extend(&self.bytes);
        file
    }

    /// As a `.gltf` with its data inside.
    fn text(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        let data = base64::engine::general_purpose::STANDARD.encode(&self.bytes);
        let uri = format!("data:application/octet-stream;base64,{data}");
        json["buffers"] = json!([{ "byteLength": self.bytes.len(), "uri": uri }]);
        json.to_string().into_bytes()
    }
}

#[test]
fn a_character_is_read_from_either_form() {
    let example = Example::new();
    let folder = tempfile::tempdir().unwrap();
    let mut with_file = example.json.clone();
    with_file["buffers"] = json!([{ "byteLength": example.bytes.len(), "uri": "own%20data.bin" }]);
    std::fs::write(folder.path().join("own data.bin"), &example.bytes).unwrap();
    for bytes in [example.glb(), example.text(), with_file.to_string().into_bytes()] {
        let (character, notes) = gltf::read(&bytes, folder.path()).unwrap();
        assert_eq!(notes, [""; 0]);
        let names: Vec<&str> = character.skeleton().joints().iter().map(|own| own.name.as_str()).collect();
        assert_eq!(names, ["Root", "Head", "Body"]);
        assert_eq!(
            (character.groups()[0].name.as_str(), character.shapes()[0].name.as_str()),
            ("Square", "bulge")
        );
        assert_eq!(character.rest(), character.bound());
        let clips: Vec<(&str, f64)> =
            character.clips().iter().map(|own| (own.name.as_str(), own.duration_secs())).collect();
        assert_eq!(clips, [("nod", 1.0), ("clip 1", 1.0)]);
        assert_eq!(character.clips()[1].tracks[0].interpolation, Interpolation::Cubic);
        // After the nod by 90° the upper corners have turned about (0, 1, 0).
        let (mut locals, mut globals) = (character.skeleton().rest(), Vec::new());
        let mut weights = [0.0];
        character.clips()[0].sample(1.0, &mut locals, &mut weights);
        character.clips()[1].sample(1.0, &mut locals, &mut weights);
        assert_eq!(weights, [2.0]);
        character.skeleton().globals(&locals, &mut globals);
        let (mut pose, mut out) = (SkinPose::default(), Vec::new());
        character.pose(&globals, &weights, Skinning::Linear, &mut pose);
        character.deform(&pose, &mut out);
        let expected = [[0.5, 0.5, 1.0], [1.0, 1.0, 0.0], [-1.0, 2.0, 0.0], [-1.0, 1.0, 0.0]];
        for (found, expected) in out.iter().zip(expected.map(Vec3::from_array)) {
            assert!(found.distance(expected) < 1e-6, "{found} {expected}");
        }
    }
}

#[test]
fn units_and_axes_are_converted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("own.GLB");
    std::fs::write(&path, Example::new().glb()).unwrap();
    let import = Import { unit: Unit::Centimetre, up: Up::Z, scale: 1.0 };
    let own = read_character(&path, &import).unwrap().character;
    assert!(own.rest().positions[2].distance(Vec3::new(0.01, 0.0, -0.02)) < 1e-8);
    let head = own.skeleton().rest_globals()[1].translation;
    assert!(head.distance(DVec3::new(0.0, 0.0, -0.01)) < 1e-9);
    // The mesh follows its joints as before.
    let (mut globals, mut out) = (own.skeleton().rest_globals(), Vec::new());
    globals[0].translation += DVec3::X;
    let mut pose = SkinPose::default();
    own.pose(&globals, &[], Skinning::Linear, &mut pose);
    own.deform(&pose, &mut out);
    assert!(out[0].distance(own.rest().positions[0] + Vec3::X * 0.5) < 1e-6);
}

/// Faults, each a place in the JSON, what is there instead (null: nothing), and a part of the
/// error.
fn faults() -> Vec<(&'static str, Value, &'static str)> {
    vec![
        ("/asset", Value::Null, "asset"),
        ("/asset/version", json!("1.0"), "its version is 1.0"),
        ("/nodes/0/children", json!([1, 9]), "nodes[0].children"),
        ("/nodes/0/children", json!([0]), "node 0 is its own ancestor"),
        ("/nodes/1/children", json!([0]), "its own ancestor"),
        ("/nodes/2/children", json!([1]), "node 1 is a child of nodes 0 and 2"),
        ("/nodes/1/translation", json!([0.0, 1.0]), ""),
        ("/nodes/1/translation", json!([0.0, "x", 0.0]), ""),
        ("/nodes/1/translation", json!([0.0, 1e39, 0.0]), ""),
        ("/nodes/2/mesh", json!(1), "nodes[2].mesh"),
        ("/nodes/2/mesh", Value::Null, "no triangles"),
        ("/nodes/2/skin", json!(7), "nodes[2].skin"),
        ("/scenes/0/nodes", json!([0, 5]), "scenes[0].nodes"),
        ("/scenes/0/nodes", json!([0]), "no triangles"),
        ("/scene", json!(3), "scene"),
        ("/meshes/0/primitives", json!([]), "no triangles"),
        ("/meshes/0/primitives/0/mode", json!(0), "no triangles"),
        ("/meshes/0/primitives/0/mode", json!(17), "mode"),
        ("/meshes/0/primitives/0/indices", json!(0), "accessor 0 has 3 numbers"),
        ("/meshes/0/primitives/0/indices", json!(99), "indices"),
        ("/meshes/0/primitives/0/attributes/POSITION", Value::Null, ""),
        ("/meshes/0/primitives/0/attributes/POSITION", json!(2), "min"),
        ("/meshes/0/primitives/0/attributes/POSITION", json!(-1), ""),
        ("/meshes/0/primitives/0/attributes/JOINTS_0", json!(2), "whole ones are"),
        ("/meshes/0/primitives/0/attributes/JOINTS_0", json!(3), "whole ones are"),
        ("/meshes/0/primitives/0/attributes/WEIGHTS_0", json!(0), "accessor 0 has 3 numbers"),
        ("/meshes/0/primitives/0/targets", json!([{ "POSITION": 2 }]), "4 numbers"),
        ("/meshes/0/primitives/0/targets", json!([{ "POSITION": 50 }]), ""),
        ("/skins/0/joints", json!([]), ""),
        ("/skins/0/joints", json!([0]), "joint 1 of 1"),
        ("/skins/0/joints", json!([0, 44]), "skins[0].joints"),
        ("/skins/0/joints", json!([0, 1, 2]), "skin 0 has 3 joints and 2"),
        ("/skins/0/inverseBindMatrices", json!(0), "3 numbers an entry where 16"),
        ("/skins/0/inverseBindMatrices", json!(70), ""),
        ("/animations/0/channels/0/target/node", json!(8), "channel 0: there is no node 8"),
        ("/animations/0/channels/0/target/path", json!("colour"), "its path is not translation"),
        ("/animations/0/channels/0/target/path", json!("translation"), "animation 0, channel 0"),
        ("/animations/0/channels/0/sampler", json!(2), ""),
        ("/animations/0/samplers/0/input", json!(7), "4 numbers an entry where 1"),
        ("/animations/0/samplers/0/input", json!(8), "do not ascend"),
        ("/animations/0/samplers/0/interpolation", json!("CUBICSPLINE"), "2 keys and 2 values, but needs 6"),
        ("/animations/0/samplers/0/interpolation", json!("SMOOTH"), "interpolation"),
        ("/animations/1/samplers/0/interpolation", json!("LINEAR"), "2 keys and 6 values, but needs 2"),
        ("/accessors/0/count", json!(5), "more than its buffer view"),
        ("/accessors/0/count", json!(0), ""),
        ("/accessors/0/count", json!(u64::MAX), ""),
        ("/accessors/0/count", json!(3), "3 vertices, 4 joints"),
        ("/accessors/0/componentType", json!(1), "componentType"),
        ("/accessors/0/type", json!("VEC9"), "type"),
        ("/accessors/0/type", json!("VEC2"), "2 numbers an entry where 3"),
        ("/accessors/0/bufferView", json!(40), "bufferView"),
        ("/accessors/0/byteOffset", json!(4), "more than its buffer view"),
        ("/accessors/0/byteOffset", json!(u64::MAX), ""),
        ("/accessors/1/bufferView", Value::Null, "accessors[1].bufferView"),
        ("/accessors/2/count", json!(3), "4 vertices, 4 joints and 3 weights"),
        ("/accessors/6/count", json!(1), "1 keys and 2 values"),
        // No memory for zeros that nothing in the file needs.
        (
            "/accessors/5",
            json!({ "componentType": 5126, "type": "VEC3", "count": 1 << 20, "sparse": { "count": 1,
            "indices": { "bufferView": 3, "componentType": 5123 }, "values": { "bufferView": 0 } } }),
            "1048576 entries, but no buffer view",
        ),
        (
            "/accessors/0/sparse",
            json!({ "count": 1, "indices": { "bufferView": 0, "componentType": 5125 },
            "values": { "bufferView": 99 } }),
            "",
        ),
        (
            "/accessors/0/sparse",
            json!({ "count": 1, "indices": { "bufferView": 8, "byteOffset": 8,
            "componentType": 5125 }, "values": { "bufferView": 0 } }),
            "sparse index 1065353216",
        ),
        (
            "/accessors/0/sparse",
            json!({ "count": 9, "indices": { "bufferView": 3, "componentType": 5125 },
            "values": { "bufferView": 0 } }),
            "sparse values are more",
        ),
        ("/bufferViews/0/buffer", json!(3), "bufferViews[0].buffer"),
        ("/bufferViews/0/byteLength", json!(9), "more than its buffer view"),
        ("/bufferViews/0/byteLength", json!(1_000_000), "more than its buffer view"),
        ("/bufferViews/0/byteOffset", json!(1_000_000), "more than its buffer view"),
        ("/bufferViews/0/byteOffset", json!(u64::MAX), ""),
        ("/bufferViews/0/byteStride", json!(250), "more than its buffer view"),
        ("/buffers", json!([{ "byteLength": 1_000_000 }]), "1000000 bytes by its header"),
        ("/buffers", json!([{ "byteLength": 8, "uri": "nowhere.bin" }]), "nowhere.bin"),
        ("/buffers", json!([{ "byteLength": 8, "uri": "." }]), "this is a folder"),
        ("/buffers", json!([{ "byteLength": 8, "uri": "data:text,abc" }]), "not in base 64"),
        ("/buffers", json!([{ "byteLength": 8, "uri": "data:x;base64,?!" }]), "not in base 64"),
        ("/extensionsRequired", json!(["KHR_draco_mesh_compression"]), "extensionsRequired"),
        ("/nodes", json!({}), ""),
        ("/meshes", json!([[]]), ""),
        ("/accessors", json!([]), ""),
    ]
}

/// Sets what is at `pointer`, or removes it if `value` is null.
fn set(json: &mut Value, pointer: &str, value: Value) {
    let (parent, key) = pointer.rsplit_once('/').unwrap();
    match json.pointer_mut(parent).unwrap() {
        Value::Array(list) => list[key.parse::<usize>().unwrap()] = value,
        Value::Object(table) if value.is_null() => drop(table.remove(key)),
        other => other[key] = value,
    }
}

#[test]
fn a_hundred_broken_files_give_one_clear_error_each() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("broken.glb");
    let check = |bytes: &[u8], what: &str, expected: &str| {
        std::fs::write(&path, bytes).unwrap();
        let error = read_character(&path, &Import::default()).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains("broken.glb") && !error.contains('\n'), "{what}: {error:?}");
        assert!(error.contains(expected), "{what}: {error:?} does not say {expected:?}");
        assert!(error.len() < 400, "{what}: {error:?}");
    };
    let mut count = 0;
    for (pointer, value, expected) in faults() {
        let mut example = Example::new();
        let what = format!("{pointer} = {value}");
        set(&mut example.json, pointer, value);
        check(&example.glb(), &what, expected);
        count += 1;
    }
    let mut short = Example::new().glb();
    short[8..12].copy_from_slice(&11u32.to_le_bytes());
    check(&short, "a size of 11", "byte 8: its size is less than its header");
    // Numbers that are none in the buffers.
    for (accessor, what) in [
        (0, "vertex 0 is not finite"),
        (4, "finite bind matrices"),
        (5, "finite entries"),
        (7, "value 0 is not finite"),
    ] {
        let mut example = Example::new();
        let at = example.json["bufferViews"][accessor]["byteOffset"].as_u64().unwrap() as usize;
        example.bytes[at..at + 4].copy_from_slice(&f32::NAN.to_le_bytes());
        check(&example.glb(), what, what);
        count += 1;
    }
    let whole = Example::new().glb();
    for at in (0..whole.len()).step_by(whole.len() / 60 + 1) {
        check(&whole[..at], "cut", "");
        count += 1;
    }
    assert!(count >= 130, "{count}");
}

#[test]
fn a_node_that_a_scene_names_twice_comes_once() {
    let mut example = Example::new();
    set(&mut example.json, "/scenes/0/nodes", json!([0, 2, 2, 1, 2]));
    let (character, _) = gltf::read(&example.glb(), Path::new("")).unwrap();
    assert_eq!((character.rest().triangles.len(), character.groups().len()), (2, 1));
}

#[test]
fn weights_and_scales_that_are_wrong_are_survived() {
    let mut example = Example::new();
    let at = example.json["bufferViews"][2]["byteOffset"].as_u64().unwrap() as usize;
    for (i, weight) in [f32::NAN, -1.0, 3.0, 0.0].into_iter().enumerate() {
        example.bytes[at + 4 * i..][..4].copy_from_slice(&weight.to_le_bytes());
    }
    set(&mut example.json, "/nodes/1/scale", json!([0.0, 0.0, 0.0]));
    set(&mut example.json, "/nodes/0/rotation", json!([0.0, 0.0, 0.0, 0.0]));
    let (character, notes) = gltf::read(&example.glb(), Path::new("")).unwrap();
    assert_eq!(notes.len(), 1, "{notes:?}");
    assert!(character.rest().positions.iter().all(|p| p.is_finite()));
}

const WALK: &str = "HIERARCHY
ROOT Hips
{
	OFFSET 0 1 0
	CHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation
	JOINT Head
	{
		OFFSET 0 0.5 0
		CHANNELS 3 Zrotation Xrotation Yrotation
		End Site
		{
			OFFSET 0 0.2 0
		}
	}
}
MOTION
Frames: 3
Frame Time: 0.0333
0 1 0 10 20 30 40 50 60
0.1 1 0 11 22 33 44 55 66
0.2 1 0 89.9 90 -170 -90 91 179
";

#[test]
fn a_hundred_broken_motions_give_one_clear_error_each() {
    let mut count = 0;
    let mut check = |text: &str| {
        if let Err(error) = bvh::read(text.as_bytes()) {
            let error = error.to_string();
            assert!(!error.contains('\n') && error.len() < 300 && error.contains("BVH"), "{error:?}");
            count += 1;
            true
        } else {
            false
        }
    };
    // Each word left out, doubled, and replaced.
    let words: Vec<&str> = WALK.split(' ').flat_map(|part| part.split_inclusive(['\n', '\t'])).collect();
    for i in 0..words.len() {
        for replacement in [vec![], vec!["none"], vec![words[i], words[i]]] {
            let mut changed = words.clone();
            changed.splice(i..=i, replacement);
            check(&changed.join(" "));
        }
    }
    for at in 0..WALK.trim_end().len() - 1 {
        // A last number that is cut within is a number still.
        assert!(check(&WALK[..at]) || at > WALK.trim_end().len() - 4, "{at}");
    }
    assert!(count > 500, "{count}");
}

#[test]
fn a_motion_that_is_written_and_read_is_the_same() {
    let own = bvh::read(WALK.as_bytes()).unwrap();
    let back = bvh::read(&bvh::write(&own.skeleton, &own.clip, own.frames, own.frame_secs)).unwrap();
    assert!(same_motion(&own, &back) < 1e-6);
}

/// The largest difference of any joint's motion in any frame.
pub fn same_motion(a: &bvh::Bvh, b: &bvh::Bvh) -> f64 {
    assert_eq!((a.frames, a.frame_secs), (b.frames, b.frame_secs));
    let (mut largest, mut globals) = (0.0f64, [Vec::new(), Vec::new()]);
    for secs in a.times() {
        for (own, globals) in [a, b].into_iter().zip(&mut globals) {
            let mut locals = own.skeleton.rest();
            own.clip.sample(secs, &mut locals, &mut []);
            own.skeleton.globals(&locals, globals);
        }
        for (a, b) in globals[0].iter().zip(&globals[1]) {
            let turn =
                (a.matrix3 - b.matrix3).to_cols_array().into_iter().fold(0.0, |l: f64, x| x.abs().max(l));
            largest = largest.max(a.translation.distance(b.translation)).max(turn);
        }
    }
    largest
}

proptest! {
    #[test]
    fn damaged_characters_and_motions_never_panic(
        spots in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
    ) {
        for mut bytes in [Example::new().glb(), Example::new().text()] {
            for (spot, value) in &spots {
                let at = spot.index(bytes.len());
                bytes[at] = *value;
            }
            let _ = gltf::read(&bytes, Path::new(""));
        }
        let mut text = WALK.as_bytes().to_vec();
        for (spot, value) in &spots {
            let at = spot.index(text.len());
            text[at] = *value;
        }
        let _ = bvh::read(&text);
    }
}
