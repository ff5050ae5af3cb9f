//! Hair in glTF files, read back by the parser that reads characters.

#![expect(clippy::unwrap_used, reason = "a helper of tests fails by panicking")]

use std::fs;
use std::path::Path;

use base64::Engine as _;
use forelock_core::groom::{Groom, Import};
use forelock_io::animation::{AnimationReader, AnimationWriter, convert};
use forelock_io::gltf::LinesWriter;
use forelock_io::{read_character, read_groom, write_groom};
use glam::Vec3;
use gltf::accessor::DataType;
use gltf::mesh::{Mode, Semantic};
use gltf::{Accessor, Gltf};

const FRAMES: usize = 4;
const TIMES: [f64; FRAMES] = [0.5, 0.75, 1.0, 1.5];

/// Strands of 4, 1 and 3 particles, with all attributes that the format holds.
fn groom() -> Groom {
    let strand = |x: f32, n: u32| (0..n).map(|i| Vec3::new(x, -0.013 * i as f32, 0.1)).collect::<Vec<_>>();
    let mut groom = Groom::from_strands([strand(0.1, 4), strand(0.2, 1), strand(-0.3, 3)]).unwrap();
    groom.widths = Some((0..8).map(|i| 1e-4 + 1e-5 * i as f32).collect());
    groom.colours = Some((0..8).map(|i| [0.1 * i as f32, 0.2, 0.3]).collect());
    groom.root_uvs = Some(vec![[0.1, 0.2], [0.3, 0.4], [0.5, 0.6]]);
    groom
}

fn at(frame: usize) -> Vec<Vec3> {
    groom().positions().iter().map(|p| *p + Vec3::new(0.03, -0.01, p.y) * frame as f32).collect()
}

/// The numbers of an accessor, whose bounds are checked.
fn numbers(file: &Gltf, accessor: &Accessor<'_>) -> Vec<f32> {
    assert_eq!(accessor.data_type(), DataType::F32);
    let view = accessor.view().unwrap();
    let bytes = &file.blob.as_ref().unwrap()[view.offset()..][..view.length()];
    let found: Vec<f32> = bytemuck::pod_collect_to_vec(bytes);
    let width = accessor.dimensions().multiplicity();
    assert_eq!(found.len(), accessor.count() * width);
    if let (Some(min), Some(max)) = (accessor.min(), accessor.max()) {
        let bound = |value: gltf::json::Value, fold: fn(f32, f32) -> f32, start: f32| {
            for (axis, own) in value.as_array().unwrap().iter().enumerate() {
                let expected = found.iter().skip(axis).step_by(width).copied().fold(start, fold);
                // The parser's float64 is off by a bit.
                assert_eq!(own.as_f64().map(|own| own as f32), Some(expected));
            }
        };
        bound(min, f32::min, f32::INFINITY);
        bound(max, f32::max, f32::NEG_INFINITY);
    }
    found
}

fn points(file: &Gltf, accessor: &Accessor<'_>) -> Vec<Vec3> {
    assert!(accessor.min().is_some() && accessor.max().is_some());
    numbers(file, accessor).as_chunks().0.iter().copied().map(Vec3::from_array).collect()
}

/// The positions of frame 0, the edges, and the displacements of the other frames.
fn parts(file: &Gltf) -> (Vec<Vec3>, Vec<[u32; 2]>, Vec<Vec<Vec3>>) {
    let primitive = file.meshes().next().unwrap().primitives().next().unwrap();
    assert_eq!(primitive.mode(), Mode::Lines);
    let view = primitive.indices().unwrap().view().unwrap();
    let bytes = &file.blob.as_ref().unwrap()[view.offset()..][..view.length()];
    let edges: Vec<u32> = bytemuck::pod_collect_to_vec(bytes);
    let rest = points(file, &primitive.get(&Semantic::Positions).unwrap());
    let targets = primitive.morph_targets().map(|target| points(file, &target.positions().unwrap()));
    (rest, edges.as_chunks().0.to_vec(), targets.collect())
}

/// Reads the file with all checks of the parser.
fn open(path: &Path) -> Gltf {
    let bytes = fs::read(path).unwrap();
    assert_eq!(bytes.len() % 4, 0);
    Gltf::from_slice(&bytes).unwrap()
}

const EDGES: [[u32; 2]; 5] = [[0, 1], [1, 2], [2, 3], [5, 6], [6, 7]];

#[test]
fn a_groom_is_lines_with_its_attributes() {
    let folder = tempfile::tempdir().unwrap();
    let [binary, text] = ["a.glb", "a.gltf"].map(|name| folder.path().join(name));
    write_groom(&binary, &groom()).unwrap();
    write_groom(&text, &groom()).unwrap();
    let file = open(&binary);
    let (positions, edges, targets) = parts(&file);
    assert_eq!((&*positions, &*edges, targets.len()), (groom().positions(), &EDGES[..], 0));
    let primitive = file.meshes().next().unwrap().primitives().next().unwrap();
    let attribute = |name: Semantic| numbers(&file, &primitive.get(&name).unwrap());
    assert_eq!(attribute(Semantic::Colors(0)), groom().colours.unwrap().as_flattened());
    assert_eq!(attribute(Semantic::Extras("WIDTH".into())), groom().widths.unwrap());
    let uvs = attribute(Semantic::TexCoords(0));
    assert_eq!(uvs[..8], [0.1, 1.0 - 0.2f32].repeat(4));
    assert_eq!(uvs[8..10], [0.3, 1.0 - 0.4f32]);
    assert_eq!(file.animations().count(), 0);

    // The text holds the same numbers.
    let own: serde_json::Value = serde_json::from_slice(&fs::read(&text).unwrap()).unwrap();
    let uri = own["buffers"][0]["uri"].as_str().unwrap();
    let numbers = uri.strip_prefix("data:application/octet-stream;base64,").unwrap();
    let decoded = base64::engine::general_purpose::STANDARD.decode(numbers).unwrap();
    assert_eq!(Some(&decoded), file.blob.as_ref());
}

#[test]
fn frames_are_morph_targets() {
    let folder = tempfile::tempdir().unwrap();
    let [cache, glb] = ["a.npz", "a.glb"].map(|name| folder.path().join(name));
    let mut writer = AnimationWriter::create(&cache, &groom(), &TIMES, false).unwrap();
    (0..FRAMES).for_each(|frame| writer.write(&at(frame)).unwrap());
    writer.finish().unwrap();
    let mut reader = AnimationReader::open(&cache, &Import::default()).unwrap().with_attributes_of(&groom());
    assert_eq!(convert(&mut reader, &glb, true, &mut |_| ()).unwrap(), FRAMES);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2, "a temporary file was left");

    let file = open(&glb);
    let (rest, edges, targets) = parts(&file);
    assert_eq!((&*rest, &*edges, targets.len()), (&*at(0), &EDGES[..], FRAMES - 1));
    let animation = file.animations().next().unwrap();
    let channel = animation.channels().next().unwrap();
    let times = numbers(&file, &channel.sampler().input());
    assert_eq!(times, TIMES.map(|time| time as f32));
    let weights = numbers(&file, &channel.sampler().output());
    for (frame, weights) in weights.chunks_exact(FRAMES - 1).enumerate() {
        let moved = |particle: usize| {
            let shift = targets.iter().zip(weights).map(|(own, weight)| own[particle] * *weight);
            rest[particle] + shift.sum::<Vec3>()
        };
        for (particle, expected) in at(frame).into_iter().enumerate() {
            assert!(moved(particle).distance(expected) < 1e-7, "frame {frame}, particle {particle}");
        }
    }
    // A control: the weights of another frame are not those of this one.
    assert!((rest[0] + targets[1][0]).distance(at(1)[0]) > 1e-3);
}

#[test]
fn one_frame_has_no_animation() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.glb");
    let mut writer = LinesWriter::create(&path, &groom(), &[3.0]).unwrap();
    writer.write_frame(&at(1)).unwrap();
    writer.finish().unwrap();
    let file = open(&path);
    assert_eq!((parts(&file).0, file.animations().count()), (at(1), 0));

    // Times below 0 are none.
    let mut writer = LinesWriter::create(&path, &groom(), &[-1.0, 0.5]).unwrap();
    (0..2).for_each(|frame| writer.write_frame(&at(frame)).unwrap());
    writer.finish().unwrap();
    let file = open(&path);
    let input = file.animations().next().unwrap().samplers().next().unwrap().input();
    assert_eq!(numbers(&file, &input), [0.0, 1.5]);
}

#[test]
fn what_the_format_cannot_hold_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.glb");
    let create = |groom: &Groom, times: &[f64]| LinesWriter::create(&path, groom, times);
    let message = |groom: &Groom, times: &[f64]| create(groom, times).map(drop).unwrap_err().to_string();
    let many: Vec<f64> = (0..40_000).map(|frame| f64::from(frame) / 60.0).collect();
    let words = message(&groom(), &many);
    assert!(words.contains("40000 frames of 8 particles take 64") && words.contains(".usdc"), "{words}");
    assert!(message(&groom(), &[0.0, 1.0, 1.0]).contains("frame 2 is not later"));
    let points = Groom::from_strands([[Vec3::ZERO]]).unwrap();
    assert!(message(&points, &[0.0]).contains("no edges"));
    let mut dark = groom();
    dark.colours = Some(vec![[f32::NAN; 3]; 8]);
    assert!(message(&dark, &[0.0]).contains("COLOR_0"));

    let mut writer = create(&groom(), &TIMES[..2]).unwrap();
    assert!(message(&groom(), &TIMES).contains("another run writes here"));
    assert!(writer.write_frame(&at(0)[1..]).unwrap_err().to_string().contains("7 positions"));
    writer.write_frame(&at(0)).unwrap();
    let mut lost = at(1);
    lost[3].y = f32::INFINITY;
    let words = writer.write_frame(&lost).unwrap_err().to_string();
    assert!(words.contains("frame 1: particle 3"), "{words}");
    assert!(writer.finish().unwrap_err().to_string().contains("1 of its 2 frames"));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn hair_is_not_read_as_a_character_or_groom() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.glb");
    write_groom(&path, &groom()).unwrap();
    let words = read_character(&path, &Import::default()).unwrap_err().to_string();
    assert!(words.contains("lines only"), "{words}");
    let words = read_groom(&path, &Import::default()).unwrap_err().to_string();
    assert!(words.contains("these can be read: .hair") && !words.contains(".gltf"), "{words}");
}
