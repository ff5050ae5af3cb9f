//! Archives as other programs write them: transforms, several strand groups, indexed attributes.

use std::io::Cursor;

use glam::Vec3;

use super::{
    Child, Reader,
    hash::checksum,
    output::{Compound, Indexed, Kind, Output, Track, Type},
    times::TimeSampling,
};

type File = Output<Cursor<Vec<u8>>>;

/// A property with one sample.
fn track(out: &mut File, name: &'static str, type_: Type, extent: u8, bytes: &[u8]) -> Track {
    let is_array = !name.starts_with(".ops") && name != "curveBasisAndType" && name != ".inherits";
    let mut track = Track::new(Kind { name, metadata: "", is_array, type_, extent });
    track.push(out, bytes).unwrap();
    track
}

/// The group of an object whose only property is the compound `name`.
fn object(
    out: &mut File,
    indexed: &mut Indexed,
    name: &'static str,
    tracks: &[Track],
    compounds: &[(&'static str, Vec<Track>)],
    children: &[(&str, &'static str, Child)],
) -> Child {
    let mut properties = Compound::new(out, indexed);
    let fill = |inner: &mut Compound<'_, _>| {
        tracks.iter().try_for_each(|track| inner.add(track, 0))?;
        compounds.iter().try_for_each(|(name, parts)| {
            inner.add_compound(name, "", |c| parts.iter().try_for_each(|part| c.add(part, 0)))
        })
    };
    properties.add_compound(name, "", fill).unwrap();
    let (properties, _) = properties.finish().unwrap();
    let mut headers = Vec::new();
    let mut parts = vec![properties];
    for &(name, metadata, group) in children {
        headers.extend((name.len() as u32).to_le_bytes());
        headers.extend(name.bytes());
        headers.push(indexed.index(metadata));
        parts.push(group);
    }
    headers.extend([0; 32]);
    parts.push(out.data(&[&headers]).unwrap());
    out.group(&parts).unwrap()
}

/// The bytes of the archive with the top object `top`.
fn finish(mut out: File, indexed: &Indexed, top: Child) -> Vec<u8> {
    let mut samplings = Vec::new();
    TimeSampling { period_secs: 1.0, times_secs: vec![0.0] }.write(1, &mut samplings);
    let [version, library] = [0i32, 10_000].map(|n| out.data(&[&n.to_le_bytes()]).unwrap());
    let metadata = out.data(&[b"_ai_Application=a test"]).unwrap();
    let samplings = out.data(&[&samplings]).unwrap();
    let indexed = out.data(&[&indexed.bytes()]).unwrap();
    let root = out.group(&[version, library, top, metadata, samplings, indexed]).unwrap();
    out.finish(root).unwrap().into_inner()
}

const CURVES: &str = "schema=AbcGeom_Curve_v2";
const XFORM: &str = "schema=AbcGeom_Xform_v3";

/// A strand group of one strand for each of `counts`, with points (i, 0, 0), and `more`.
fn strands(
    out: &mut File,
    indexed: &mut Indexed,
    counts: &[i32],
    basis: [u8; 4],
    more: Vec<(&'static str, Vec<Track>)>,
) -> Child {
    let points: Vec<f32> = (0..counts.iter().sum()).flat_map(|i| [i as f32, 0.0, 0.0]).collect();
    let tracks = [
        track(out, "P", Type::F32, 3, bytemuck::cast_slice(&points)),
        track(out, "nVertices", Type::I32, 1, bytemuck::cast_slice(counts)),
        track(out, "curveBasisAndType", Type::U8, 4, &basis),
        track(out, "width", Type::F32, 1, &0.5f32.to_le_bytes()),
    ];
    object(out, indexed, ".geom", &tracks, &more, &[])
}

/// An object with `ops` and `vals` above the strand group `child`.
fn above(
    out: &mut File,
    indexed: &mut Indexed,
    ops: &[u8],
    vals: &[f64],
    child: (&'static str, Child),
) -> Child {
    let tracks = [
        track(out, ".ops", Type::U8, ops.len() as u8, ops),
        track(out, ".vals", Type::F64, 1, bytemuck::cast_slice(vals)),
    ];
    object(out, indexed, ".xform", &tracks, &[], &[("child", child.0, child.1)])
}

#[test]
fn groups_are_joined_with_transforms_and_indexed_attributes() {
    let (mut out, mut indexed) = (Output::new(Cursor::new(Vec::new())).unwrap(), Indexed::default());
    let values = |out: &mut File, name, type_, numbers: &[i32]| {
        track(out, name, type_, 1, bytemuck::cast_slice(numbers))
    };
    let uvs = [0.0f32, 0.25, 0.5, 0.75];
    let uv = vec![
        track(&mut out, ".vals", Type::F32, 2, bytemuck::cast_slice(&uvs)),
        values(&mut out, ".indices", Type::I32, &[1, 0]),
    ];
    let labels = vec![
        values(&mut out, "groom_group_id", Type::I32, &[7]),
        values(&mut out, "groom_id", Type::I32, &[5, 4]),
        track(&mut out, "groom_guide", Type::I16, 1, &[1, 0, 0, 0]),
        // As triples, and as a list of numbers.
        track(&mut out, "groom_guide_weights", Type::F32, 3, bytemuck::cast_slice(&[1.0f32, 0.0, 0.0])),
        values(&mut out, "groom_closest_guides", Type::I32, &[5, -1, -1, 5, 4, -1]),
        values(&mut out, "groom_version_major", Type::I32, &[1]),
    ];
    let linear = [1, 0, 0, 0];
    let more = vec![("uv", uv), (".arbGeomParams", labels)];
    let first = strands(&mut out, &mut indexed, &[2, 3], linear, more);
    let scaled = above(&mut out, &mut indexed, &[0x00], &[2.0, 2.0, 2.0], (CURVES, first));
    let moved = above(&mut out, &mut indexed, &[0x10], &[0.0, 1.0, 0.0], (XFORM, scaled));
    // Of a cubic curve all points are kept.
    let second = strands(&mut out, &mut indexed, &[4], [0, 0, 1, 1], Vec::new());
    let children = [("moved", XFORM, moved), ("second", CURVES, second)];
    let top = object(&mut out, &mut indexed, "none", &[], &[], &children);
    let bytes = finish(out, &indexed, top);

    let mut reader = Reader::open(Cursor::new(bytes)).unwrap();
    assert_eq!(reader.unit(), forelock_core::groom::Unit::Centimetre);
    assert_eq!(reader.names().collect::<Vec<_>>(), ["/moved/child/child", "/second"]);
    let contents = reader.read(0).unwrap();
    let groom = contents.groom;
    assert_eq!(groom.strand_offsets(), [0, 2, 5, 9]);
    assert_eq!(groom.strand(1), [2.0, 3.0, 4.0].map(|x| Vec3::new(2.0 * x, 1.0, 0.0)));
    assert_eq!(groom.strand(2), [0.0, 1.0, 2.0, 3.0].map(|x| Vec3::new(x, 0.0, 0.0)));
    assert_eq!(groom.widths.unwrap(), [1.0, 1.0, 1.0, 1.0, 1.0, 0.5, 0.5, 0.5, 0.5]);
    // The second group has none.
    assert_eq!(groom.root_uvs, None);
    assert_eq!(groom.labels.ids, Some(vec![5, 4, 6]));
    assert_eq!(groom.labels.group_ids, Some(vec![7, 7, 0]));
    assert_eq!(groom.labels.guides, Some(vec![true, false, false]));
    assert_eq!(groom.labels.closest_guides, Some(vec![[5, -1, -1], [5, 4, -1], [-1; 3]]));
    assert_eq!(groom.labels.guide_weights, Some(vec![[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0; 3]]));
}

#[test]
fn indexed_attributes_are_read() {
    let (mut out, mut indexed) = (Output::new(Cursor::new(Vec::new())).unwrap(), Indexed::default());
    let uvs = [0.0f32, 0.25, 0.5, 0.75];
    let uv = vec![
        track(&mut out, ".vals", Type::F32, 2, bytemuck::cast_slice(&uvs)),
        track(&mut out, ".indices", Type::I32, 1, bytemuck::cast_slice(&[1, 0])),
    ];
    let group = strands(&mut out, &mut indexed, &[2, 3], [1, 0, 0, 0], vec![("uv", uv)]);
    let top = object(&mut out, &mut indexed, "none", &[], &[], &[("a", CURVES, group)]);
    let contents = Reader::open(Cursor::new(finish(out, &indexed, top))).unwrap().read(0).unwrap();
    assert_eq!(contents.groom.root_uvs, Some(vec![[0.5, 0.75], [0.0, 0.25]]));
}

/// An object that is its own child, and one that is the child of many.
#[test]
fn cycles_and_shared_groups_are_refused() {
    let (mut out, mut indexed) = (Output::new(Cursor::new(Vec::new())).unwrap(), Indexed::default());
    let group = strands(&mut out, &mut indexed, &[2], [1, 0, 0, 0], Vec::new());
    let children = [("a", CURVES, group); 200];
    let top = object(&mut out, &mut indexed, "none", &[], &[], &children);
    let words = |bytes| Reader::open(Cursor::new(bytes)).err().unwrap().to_string();
    let bytes = finish(out, &indexed, top);
    assert!(words(bytes.clone()).contains("groups contain each other or overlap"));
    // Each child of the top object becomes the top object.
    let at = top.offset() as usize + 16;
    let mut cycle = bytes;
    cycle[at..at + 8].copy_from_slice(&top.0.to_le_bytes());
    let words = words(cycle);
    assert!(words.contains("overlap") || words.contains("deep"), "{words}");
}

/// Objects that nest without end, though each once.
#[test]
fn objects_that_lie_too_deep_are_refused() {
    let (mut out, mut indexed) = (Output::new(Cursor::new(Vec::new())).unwrap(), Indexed::default());
    let mut group = strands(&mut out, &mut indexed, &[2], [1, 0, 0, 0], Vec::new());
    let mut metadata = CURVES;
    for _ in 0..200 {
        group = above(&mut out, &mut indexed, &[], &[], (metadata, group));
        metadata = XFORM;
    }
    let error = Reader::open(Cursor::new(finish(out, &indexed, group))).err().unwrap();
    assert!(error.to_string().contains("objects lie more than 128 deep"), "{error}");
}

/// Many small objects with one large sample would take much more memory than the file.
#[test]
fn a_sample_that_many_groups_share_is_read_some_times_only() {
    let read = |groups: usize| {
        let (mut out, mut indexed) = (Output::new(Cursor::new(Vec::new())).unwrap(), Indexed::default());
        let points = [0.0f32; 3 * 10_000];
        let tracks = [
            track(&mut out, "P", Type::F32, 3, bytemuck::cast_slice(&points)),
            track(&mut out, "nVertices", Type::I32, 1, &10_000i32.to_le_bytes()),
        ];
        let mut group = || object(&mut out, &mut indexed, ".geom", &tracks, &[], &[]);
        let children: Vec<_> = (0..groups).map(|_| ("a", CURVES, group())).collect();
        let top = object(&mut out, &mut indexed, "none", &[], &[], &children);
        Reader::open(Cursor::new(finish(out, &indexed, top))).unwrap().read(0)
    };
    assert_eq!(read(5).unwrap().groom.strand_count(), 5);
    let error = read(50).unwrap_err().to_string();
    assert!(error.contains("the strands take over 6 times the bytes of the file"), "{error}");
}

#[test]
fn strands_and_points_that_do_not_match_are_refused() {
    for (counts, words) in [([2, 2], "have 4 points, but there are 3"), ([4, -1], "-1 points, below 0")] {
        let (mut out, mut indexed) = (Output::new(Cursor::new(Vec::new())).unwrap(), Indexed::default());
        let tracks = [
            track(&mut out, "P", Type::F32, 3, &[0; 36]),
            track(&mut out, "nVertices", Type::I32, 1, bytemuck::cast_slice(&counts)),
        ];
        let group = object(&mut out, &mut indexed, ".geom", &tracks, &[], &[]);
        let top = object(&mut out, &mut indexed, "none", &[], &[], &[("a", CURVES, group)]);
        let mut reader = Reader::open(Cursor::new(finish(out, &indexed, top))).unwrap();
        let error = reader.read(0).unwrap_err().to_string();
        assert!(error.contains(words) && error.contains("`/a`"), "{error}");
    }
}

#[test]
fn equal_contents_have_equal_checksums_and_others_have_not() {
    assert_eq!(checksum(b"hair"), checksum(b"hair"));
    assert_ne!(checksum(b"hair"), checksum(b"hail"));
    assert_ne!(checksum(&[0; 16]), checksum(&[0; 17]));
}

/// A pyramid below a transform: its polygons are clockwise, and in the second sample its top is
/// elsewhere.
#[test]
fn meshes_become_a_character() {
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.5, 1.0f32]];
    let mut bent = corners;
    bent[4] = [0.5, 0.75, 1.0];
    let archive = |counts: &[i32], indices: &[i32]| {
        let (mut out, mut indexed) = (Output::new(Cursor::new(Vec::new())).unwrap(), Indexed::default());
        let mut points = track(&mut out, "P", Type::F32, 3, bytemuck::cast_slice(&corners));
        points.push(&mut out, bytemuck::cast_slice(&bent)).unwrap();
        let tracks = [
            points,
            track(&mut out, ".faceCounts", Type::I32, 1, bytemuck::cast_slice(counts)),
            track(&mut out, ".faceIndices", Type::I32, 1, bytemuck::cast_slice(indices)),
        ];
        let mesh = object(&mut out, &mut indexed, ".geom", &tracks, &[], &[]);
        let moved = above(&mut out, &mut indexed, &[0x10], &[0.0, 2.0, 0.0], (MESH, mesh));
        let top = object(&mut out, &mut indexed, "none", &[], &[], &[("body", XFORM, moved)]);
        super::read_character(Cursor::new(finish(out, &indexed, top)))
    };
    let (own, unit, notes) = archive(&[4, 3], &[0, 1, 2, 3, 1, 0, 4]).unwrap();
    assert_eq!((unit, notes.len()), (forelock_core::groom::Unit::Metre, 0));
    assert_eq!(own.bound().triangles, [[3, 1, 0], [3, 2, 1], [4, 0, 1]]);
    let expected = corners.map(|[x, y, z]| Vec3::new(x, y + 2.0, z));
    assert_eq!(own.rest().positions, expected);
    assert_eq!(own.groups()[0].name, "/body/child");
    assert_eq!((own.shapes().len(), own.clips()[0].duration_secs()), (1, 1.0));
    for (counts, indices, words) in [
        (&[4, 3][..], &[0, 1, 2, 3, 1, 0][..], "more corners than it has"),
        (&[-3], &[0, 1, 2], "more corners than it has"),
        (&[3], &[0, -1, 2], "a corner that is no vertex"),
        (&[3], &[0, 1, 7], "a corner at vertex 7"),
        (&[], &[], "no triangles"),
    ] {
        let error = archive(counts, indices).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    }
    let (mut out, mut indexed) = (Output::new(Cursor::new(Vec::new())).unwrap(), Indexed::default());
    let top = object(&mut out, &mut indexed, "none", &[], &[], &[]);
    let error = super::read_character(Cursor::new(finish(out, &indexed, top))).map(|_| ()).unwrap_err();
    assert!(error.to_string().contains("there is no body"), "{error}");
}

const MESH: &str = "schema=AbcGeom_PolyMesh_v1;schemaBaseType=AbcGeom_GeomBase_v1";

/// A triangle strip with the points `points` of each sample, below a transform `ops` with `vals`.
fn body(points: &[Vec<f32>], ops: u8, vals: &[[f64; 3]], repeats: u32) -> Vec<u8> {
    let (mut out, mut indexed) = (Output::new(Cursor::new(Vec::new())).unwrap(), Indexed::default());
    let mut p = track(&mut out, "P", Type::F32, 3, bytemuck::cast_slice(&points[0]));
    p.repeat_to(repeats);
    points[1..].iter().for_each(|own| p.push(&mut out, bytemuck::cast_slice(own)).unwrap());
    let corners: Vec<i32> = (0..points[0].len() as i32 / 3 - 2).flat_map(|k| [k, k + 1, k + 2]).collect();
    let counts = vec![3; corners.len() / 3];
    let tracks = [
        p,
        track(&mut out, ".faceCounts", Type::I32, 1, bytemuck::cast_slice(&counts)),
        track(&mut out, ".faceIndices", Type::I32, 1, bytemuck::cast_slice(&corners)),
    ];
    let mesh = object(&mut out, &mut indexed, ".geom", &tracks, &[], &[]);
    let mut moves = track(&mut out, ".vals", Type::F64, 1, bytemuck::cast_slice(&vals[0]));
    vals[1..].iter().for_each(|own| moves.push(&mut out, bytemuck::cast_slice(own)).unwrap());
    let moves = [track(&mut out, ".ops", Type::U8, 1, &[ops]), moves];
    let moved = object(&mut out, &mut indexed, ".xform", &moves, &[], &[("child", MESH, mesh)]);
    let top = object(&mut out, &mut indexed, "none", &[], &[], &[("body", XFORM, moved)]);
    finish(out, &indexed, top)
}

fn ball(vertices: u16) -> Vec<f32> {
    (0..3 * vertices).map(|i| (1.3 * f32::from(i)).sin()).collect()
}

/// A mesh that is stored once, and has a blend shape for each of many stretching transforms, would
/// take much more memory than the file.
#[test]
fn the_memory_of_a_body_is_bounded_by_its_file() {
    let vals: Vec<[f64; 3]> = (0..20_000u16).map(|k| [1.0 + 0.01 * f64::from(k), 1.0, 1.0]).collect();
    let read = |frames, ops| super::read_character(Cursor::new(body(&[ball(100)], ops, &vals[..frames], 1)));
    let error = read(20_000, 0x00).map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("the meshes take over 16 times the bytes of the file"), "{error}");
    // Few of them do not, and shifts take none at all.
    assert_eq!(read(5, 0x00).unwrap().0.shapes().len(), 4);
    assert_eq!(read(2000, 0x10).unwrap().0.shapes().len(), 0);
}

/// A header may say that samples begin to differ late: those before take no bytes in the file. A
/// body at rest stays so until then.
#[test]
fn samples_that_are_not_stored_take_no_memory() {
    for frames in [24, 3_000_000_000] {
        let samples = [ball(9), ball(9).iter().map(|x| x + 1.0).collect()];
        let late = body(&samples, 0x10, &[[0.0; 3]], frames);
        let (own, ..) = super::read_character(Cursor::new(late)).unwrap();
        let clip = &own.clips()[0];
        assert_eq!(clip.duration_secs(), f64::from(frames));
        let mut locals = own.skeleton().rest();
        let rest = locals.clone();
        clip.sample(f64::from(frames - 1), &mut locals, &mut []);
        assert_eq!(locals[0].translation, rest[0].translation);
        clip.sample(f64::from(frames), &mut locals, &mut []);
        assert!(locals[0].translation.distance(rest[0].translation) > 1.0);
    }
}

/// Frames that the file does not have would take 8 bytes each in a list of their times.
#[test]
fn too_many_frames_are_refused() {
    let open = |frames| {
        let (mut out, mut indexed) = (Output::new(Cursor::new(Vec::new())).unwrap(), Indexed::default());
        let mut points = track(&mut out, "P", Type::F32, 3, &[0; 24]);
        points.repeat_to(frames);
        let tracks = [points, track(&mut out, "nVertices", Type::I32, 1, &2i32.to_le_bytes())];
        let group = object(&mut out, &mut indexed, ".geom", &tracks, &[], &[]);
        let top = object(&mut out, &mut indexed, "none", &[], &[], &[("a", CURVES, group)]);
        Reader::open(Cursor::new(finish(out, &indexed, top)))
    };
    assert_eq!(open(1_000_000).unwrap().frames(), 1_000_000);
    let error = open(2_000_000_000).err().unwrap().to_string();
    assert!(error.contains("2000000000 frames are too many"), "{error}");
}

/// Identities of 64 bits, and one of 32 bits without a sign that does not fit.
#[test]
fn labels_beyond_32_bits_are_refused() {
    let read = |type_: Type, bytes: &[u8], code: u8| {
        let (mut out, mut indexed) = (Output::new(Cursor::new(Vec::new())).unwrap(), Indexed::default());
        let ids = vec![track(&mut out, "groom_id", type_, 1, bytes)];
        let more = vec![(".arbGeomParams", ids)];
        let group = strands(&mut out, &mut indexed, &[2, 2], [1, 0, 0, 0], more);
        let top = object(&mut out, &mut indexed, "none", &[], &[], &[("a", CURVES, group)]);
        let mut bytes = finish(out, &indexed, top);
        // The writer has no integers of 64 bits, nor any without a sign.
        let name = bytes.windows(8).position(|own| own == b"groom_id").unwrap();
        bytes[name - 12] = bytes[name - 12] & 0x0f | code << 4;
        Reader::open(Cursor::new(bytes)).unwrap().read(0)
    };
    let wide: Vec<u8> = [7i64, -8].iter().flat_map(|id| id.to_le_bytes()).collect();
    assert_eq!(read(Type::F64, &wide, 8).unwrap().groom.labels.ids, Some(vec![7, -8]));
    let wide: Vec<u8> = [7i64, 5_000_000_000].iter().flat_map(|id| id.to_le_bytes()).collect();
    let error = read(Type::F64, &wide, 8).unwrap_err().to_string();
    assert!(error.contains("`/a`: `groom_id` of strand 1 is 5000000000, but must be"), "{error}");
    let error = read(Type::I32, &[9, 0, 0, 0, 0, 0, 0, 0x80], 5).unwrap_err().to_string();
    assert!(error.contains("of strand 1 is 2147483648"), "{error}");
}
