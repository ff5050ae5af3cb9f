//! Whole files to begin with: made by the writers of the crate or by hand, those of its tests, and
//! those of a folder.

use std::error::Error;
use std::fs;
use std::path::Path;

use forelock_core::body::TriMesh;
use forelock_core::groom::{Groom, Import, Labels, RootBinding};
use forelock_io::animation::{AnimationReader, AnimationWriter, convert};
use forelock_io::{CacheWriter, alembic, bvh, gltf, hair, npz, obj, ply, tfx, usc, usd};
use glam::Vec3;

use super::ogawa;

/// Larger files take too long to read again and again, bytes.
const LARGEST: u64 = 300 << 10;

/// The files for `reader`, and those of `folder` with its ending.
pub fn of(reader: &str, folder: Option<&Path>) -> Vec<Vec<u8>> {
    let mut seeds = made(reader).unwrap_or_else(|error| {
        eprintln!("{reader}: {error}");
        Vec::new()
    });
    let tests = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data"));
    for folder in [Some(tests), Some(&tests.join("usd")), folder].into_iter().flatten() {
        let mut files: Vec<_> = fs::read_dir(folder).into_iter().flatten().flatten().collect();
        files.sort_by_key(fs::DirEntry::file_name);
        for path in files.into_iter().map(|file| file.path()) {
            let ending = path.extension().map(|own| own.to_string_lossy().to_lowercase()).unwrap_or_default();
            let is_small = path.metadata().is_ok_and(|own| own.is_file() && own.len() <= LARGEST);
            if is_small && endings(reader).contains(&&*ending) {
                let is_read =
                    |bytes: &Vec<u8>| reader != "body" || bytes.windows(8).any(|own| own == b"def Mesh");
                seeds.extend(fs::read(path).ok().filter(is_read));
            }
        }
    }
    seeds
}

/// The endings of the files that `reader` reads.
fn endings(reader: &str) -> &[&str] {
    match reader {
        "arrays" | "cache" | "npz" => &["npz"],
        "obj" | "mesh" => &["obj"],
        "usdc" => &["usdc", "usd"],
        "data" => &["data"],
        "bin" => &["bin"],
        "hair" => &["hair"],
        "tfx" => &["tfx"],
        "ply" => &["ply"],
        "abc" => &["abc"],
        "usda" | "body" => &["usda"],
        "glb" => &["glb"],
        "gltf" => &["gltf"],
        "bvh" => &["bvh"],
        "tfxskin" => &["tfxskin"],
        "tfxbone" => &["tfxbone"],
        _ => &[],
    }
}

type Made = Result<Vec<Vec<u8>>, Box<dyn Error>>;

/// The files for `reader` that are made here.
fn made(reader: &str) -> Made {
    let (even, uneven) = (groom(&[6; 5])?, groom(&[4, 9, 2, 5])?);
    let mut bare = even.clone();
    (bare.widths, bare.colours, bare.transparencies) = (None, None, None);
    (bare.root_uvs, bare.pinned, bare.bindings, bare.stiffness) = (None, None, None, None);
    bare.labels = Labels::default();
    Ok(match reader {
        "hair" => vec![hair::write(&even)?, hair::write(&uneven)?, hair::write(&bare)?],
        "data" => vec![usc::write(&even)?, usc::write(&uneven)?],
        "bin" => vec![ct2hair(&uneven)],
        "tfx" => vec![tfx::write(&even)?, tfx::write(&bare)?, tfx_3(&even)],
        "npz" | "arrays" => {
            vec![npz::write_groom(&even), npz::write_groom(&uneven), npz::write_groom(&bare), moving("npz")?]
        }
        "cache" => vec![moving("npz")?, cache()?],
        "obj" => vec![obj::write_groom(&uneven)],
        "mesh" => vec![mesh()?],
        "ply" => vec![ply::write(&even)?, ply_text(&even)],
        "abc" => vec![alembic::write(&bare)?, alembic::write(&even)?, moving("abc")?, ogawa::body()],
        "usda" => vec![usd::write_text(&even), usd::write_text(&uneven)],
        "usdc" => vec![usd::write_binary(&even), usd::write_binary(&uneven), moving("usdc")?],
        "glb" => vec![gltf::write_binary(&even)?, moving("glb")?, binary(CHARACTER)],
        "gltf" => vec![gltf::write_text(&uneven)?, CHARACTER.into()],
        "body" => vec![BODY.into()],
        "bvh" => vec![MOTION.into(), written_motion()?],
        "tfxskin" => vec![triangle_skin()],
        "tfxbone" => vec![bone_skin()],
        _ => Vec::new(),
    })
}

/// A groom with all attributes and strands of `counts` particles.
fn groom(counts: &[usize]) -> Result<Groom, Box<dyn Error>> {
    let strand = |(s, &n): (usize, &usize)| {
        let point = |i: usize| Vec3::new(0.1 * s as f32, -0.013 * i as f32, 0.02 * (i * i) as f32);
        (0..n).map(point).collect::<Vec<_>>()
    };
    let mut groom = Groom::from_strands(counts.iter().enumerate().map(strand))?;
    let (particles, strands) = (groom.particle_count(), groom.strand_count());
    groom.widths = Some((0..particles).map(|i| 1e-4 + 1e-6 * i as f32).collect());
    groom.colours = Some((0..particles).map(|i| [0.01 * i as f32, 0.5, 0.25]).collect());
    groom.transparencies = Some(vec![0.125; particles]);
    groom.root_uvs = Some((0..strands).map(|s| [0.1 * s as f32, 0.75]).collect());
    groom.pinned = Some(vec![1; strands]);
    groom.stiffness = Some(vec![1.0; strands]);
    let binding = RootBinding { triangle: 7, barycentric: [0.5, 0.25, 0.25], distance: 1e-3 };
    groom.bindings = Some(vec![binding; strands]);
    groom.labels = Labels {
        ids: Some((0..strands as i32).rev().collect()),
        group_ids: Some(vec![3; strands]),
        guides: Some((0..strands).map(|s| s % 2 == 0).collect()),
        closest_guides: Some(vec![[0, 2, -1]; strands]),
        guide_weights: Some(vec![[0.75, 0.25, 0.0]; strands]),
    };
    Ok(groom)
}

/// Six frames of moving strands in the format of `ending`.
fn moving(ending: &str) -> Result<Vec<u8>, Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let [cache, path] = ["a.npz", &format!("b.{ending}")].map(|name| folder.path().join(name));
    let (groom, times) = (groom(&[5; 4])?, [0.0, 0.25, 0.5, 0.75, 1.0, 1.25]);
    let mut writer = AnimationWriter::create(&cache, &groom, &times, false)?;
    for time in times {
        let moved: Vec<Vec3> = groom.positions().iter().map(|p| *p + Vec3::X * time as f32).collect();
        writer.write(&moved)?;
    }
    writer.finish()?;
    if ending == "npz" {
        return Ok(fs::read(cache)?);
    }
    let mut reader = AnimationReader::open(&cache, &Import::default())?.with_attributes_of(&groom);
    convert(&mut reader, &path, true, &mut |_| ())?;
    Ok(fs::read(path)?)
}

/// A cache as a run writes it, with an array more.
fn cache() -> Result<Vec<u8>, Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("a.npz");
    let fps = npz::Array::vector(vec![60.0f64]);
    let mut writer = CacheWriter::create(&path, &[0, 2, 5], &[("fps", fps)])?;
    for frame in 0..8 {
        writer.append(f64::from(frame) / 60.0, &[Vec3::splat(frame as f32); 5])?;
    }
    writer.finish()?;
    Ok(fs::read(path)?)
}

fn words(words: &[u32]) -> impl Iterator<Item = u8> + '_ {
    words.iter().flat_map(|word| word.to_le_bytes())
}

fn floats(floats: &[f32]) -> impl Iterator<Item = u8> + '_ {
    floats.iter().flat_map(|number| number.to_le_bytes())
}

fn ct2hair(groom: &Groom) -> Vec<u8> {
    let mut bytes: Vec<u8> = words(&[groom.strand_count() as u32]).collect();
    for strand in groom.strands() {
        bytes.extend(words(&[strand.len() as u32]));
        for point in strand {
            bytes.extend(floats(&point.to_array()).chain(floats(&[0.0, 1.0, 0.0])).chain([0; 4]));
        }
    }
    bytes
}

/// A file of TressFX 3.0 with strands of equal length.
fn tfx_3(groom: &Groom) -> Vec<u8> {
    let (strands, particles) = (groom.strand_count() as u32, groom.particle_count() as u32);
    let mut bytes: Vec<u8> = floats(&[3.0]).chain(words(&[strands, particles / strands])).collect();
    bytes.resize(144, 0);
    let thickness = 296 + 12 * particles;
    let uvs = thickness + 4 * strands;
    bytes.extend(words(&[296, thickness, uvs, uvs + 8 * strands]));
    bytes.resize(296, 0);
    groom.positions().iter().for_each(|point| bytes.extend(floats(&point.to_array())));
    bytes.extend(floats(&vec![0.5; (3 * strands + 4 * particles) as usize]));
    bytes
}

fn ply_text(groom: &Groom) -> Vec<u8> {
    let mut text = format!(
        "ply\nformat ascii 1.0\ncomment by hand\nelement vertex {}\nproperty float x\nproperty float y\n\
         property float z\nproperty int strand\nend_header\n",
        groom.particle_count()
    );
    for (s, strand) in groom.strands().enumerate() {
        strand.iter().for_each(|p| text += &format!("{} {} {} {s}\n", p.x, p.y, p.z));
    }
    text.into_bytes()
}

fn mesh() -> Result<Vec<u8>, Box<dyn Error>> {
    let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
    Ok(obj::write_mesh(&TriMesh::new(positions, vec![[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])?))
}

fn triangle_skin() -> Vec<u8> {
    let mut bytes: Vec<u8> = words(&[1, 3, 8]).collect();
    bytes.resize(136, 0);
    bytes.extend(words(&[268, 340]));
    bytes.resize(268, 0);
    for triangle in [2, 5, 7] {
        bytes.extend(words(&[0, triangle]).chain(floats(&[0.5, 0.25, 0.25])).chain([0; 4]));
    }
    bytes.extend(floats(&[0.5; 9]));
    bytes
}

fn bone_skin() -> Vec<u8> {
    let mut bytes: Vec<u8> = words(&[2]).collect();
    for (index, name) in [(0, "neck\0"), (1, "head\0")] {
        bytes.extend(words(&[index, 5]).chain(name.bytes()));
    }
    bytes.extend(words(&[3]));
    for strand in 0..3 {
        bytes.extend(words(&[strand]));
        for (bone, weight) in [(1, 0.75), (0, 0.25), (0, 0.0), (0, 0.0)] {
            bytes.extend(words(&[bone]).chain(floats(&[weight])));
        }
    }
    bytes
}

fn written_motion() -> Result<Vec<u8>, Box<dyn Error>> {
    let own = bvh::read(MOTION.as_bytes())?;
    Ok(bvh::write(&own.skeleton, &own.clip, 3, 0.25))
}

/// The `.glb` of a `.gltf`, without its binary chunk.
fn binary(text: &str) -> Vec<u8> {
    let padded = text.len().next_multiple_of(4);
    let mut bytes = b"glTF".to_vec();
    bytes.extend(words(&[2, 20 + padded as u32, padded as u32]).chain(*b"JSON"));
    bytes.extend(text.bytes());
    bytes.resize(20 + padded, b' ');
    bytes
}

/// Two faces whose points and frame move.
const BODY: &str = r#"#usda 1.0
(
    metersPerUnit = 0.01
    upAxis = "Z"
    timeCodesPerSecond = 24
)
def Xform "root"
{
    matrix4d xformOp:transform.timeSamples = {
        0: ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)),
        12: ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (5, 0, 0, 1)),
    }
    uniform token[] xformOpOrder = ["xformOp:transform"]
    def Mesh "body"
    {
        int[] faceVertexCounts = [4, 3]
        int[] faceVertexIndices = [0, 1, 2, 3, 0, 1, 4]
        uniform token orientation = "rightHanded"
        point3f[] points.timeSamples = {
            0: [(0, 0, 0), (9, 0, 0), (9, 9, 0), (0, 9, 0), (5, 5, 9)],
            12: [(0, 0, 1), (9, 0, 0), (9, 9, 0), (0, 9, 2), (5, 5, 9)],
        }
    }
}
"#;

const MOTION: &str = "HIERARCHY\nROOT Hips\n{\n  OFFSET 0 90 0\n  CHANNELS 6 Xposition Yposition Zposition \
    Zrotation Xrotation Yrotation\n  JOINT Spine\n  {\n    OFFSET 0 20 0\n    CHANNELS 3 Zrotation Xrotation \
    Yrotation\n    End Site\n    {\n      OFFSET 0 10 0\n    }\n  }\n}\nMOTION\nFrames: 2\nFrame Time: 0.0333\n\
    0 90 0 0 0 0 10 0 0\n1 91 0 0 5 0 20 0 3\n";

/// A triangle that follows two joints, with a blend shape whose accessor is sparse, and a clip.
const CHARACTER: &str = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0,2]}],
"nodes":[{"name":"Root","children":[1]},{"name":"Head","translation":[0,1,0]},{"mesh":0,"skin":0}],
"meshes":[{"name":"Face","weights":[0],"extras":{"targetNames":["smile"]},"primitives":[{"indices":3,
"attributes":{"POSITION":0,"JOINTS_0":1,"WEIGHTS_0":2},"targets":[{"POSITION":4}]}]}],
"skins":[{"joints":[0,1]}],"animations":[{"name":"nod",
"channels":[{"sampler":0,"target":{"node":1,"path":"translation"}},
{"sampler":1,"target":{"node":2,"path":"weights"}}],
"samplers":[{"input":5,"output":6},{"input":5,"output":5,"interpolation":"STEP"}]}],
"accessors":[{"bufferView":0,"componentType":5126,"type":"VEC3","count":3,"min":[0,0,0],"max":[1,1,0]},
{"bufferView":1,"componentType":5121,"type":"VEC4","count":3},
{"bufferView":2,"componentType":5126,"type":"VEC4","count":3},
{"bufferView":3,"componentType":5121,"type":"SCALAR","count":3},
{"componentType":5126,"type":"VEC3","count":3,"sparse":{"count":1,
"indices":{"bufferView":3,"componentType":5121},"values":{"bufferView":0}}},
{"bufferView":4,"componentType":5126,"type":"SCALAR","count":2,"min":[0],"max":[1]},
{"bufferView":0,"componentType":5126,"type":"VEC3","count":2}],
"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":12},
{"buffer":0,"byteOffset":48,"byteLength":48},{"buffer":0,"byteOffset":96,"byteLength":3},
{"buffer":0,"byteOffset":100,"byteLength":8}],
"buffers":[{"byteLength":108,"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAAEAAAABAAAAAQAAAAAAPwAAAD8AAAAAAAAAAAAAAD8AAAA/AAAAAAAAAAAAAAA/AAAAPwAAAAAAAAAAAAECAAAAAAAAAIA/"}]}"#;
