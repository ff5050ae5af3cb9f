//! Layers of Universal Scene Description: those of the library of USD, our own, and damaged ones.

#![expect(clippy::unwrap_used, reason = "a helper of tests fails by panicking")]

use std::{
    cell::Cell,
    fs::{self, File},
    io::{self, Cursor, Read, Seek, SeekFrom},
    path::Path,
};

use crate::common::grooms;
use forelock_core::groom::{Groom, Import, Unit, Up, ZUp};
use forelock_io::{Data, Stored, Usd, UsdCacheWriter, WriteError, npz, read_groom, usd, write_groom};
use glam::Vec3;
use proptest::prelude::*;

/// Written by usd-core 26.11: `tools/check_usd.py --make crates/forelock-io/tests/data/usd`.
const BY_PXR: [(&str, &[u8]); 5] = [
    ("text", include_bytes!("../data/usd/pxr.usda")),
    ("0.4", include_bytes!("../data/usd/pxr_0.4.usdc")),
    ("0.5", include_bytes!("../data/usd/pxr_0.5.usdc")),
    ("0.6", include_bytes!("../data/usd/pxr_0.6.usdc")),
    ("0.8", include_bytes!("../data/usd/pxr_0.8.usdc")),
];
/// What that library says of them: the points in the stage, centimetres, z up.
const OF_PXR: &[u8] = include_bytes!("../data/usd/pxr.npz");

fn read(bytes: &[u8]) -> Result<Groom, String> {
    let layer = Usd::open(Cursor::new(bytes)).map_err(|e| e.to_string())?;
    let groom = layer.frame(0).map_err(|e| e.to_string())?;
    let last = layer.times_secs().len().saturating_sub(1);
    layer.frame(last).map_err(|e| e.to_string())?;
    Ok(groom)
}

fn layer(text: &str) -> Usd<Cursor<Vec<u8>>> {
    Usd::open(Cursor::new(format!("#usda 1.0\n{text}").into_bytes())).unwrap()
}

#[test]
fn layers_of_the_library_read_as_it_reads_them() {
    let wanted = npz::read(Cursor::new(OF_PXR)).unwrap();
    let (Data::F64(times), Data::F64(points)) = (&wanted["times"].data, &wanted["positions"].data) else {
        panic!("the arrays are float64");
    };
    for (name, bytes) in BY_PXR {
        let layer = Usd::open(Cursor::new(bytes)).unwrap();
        assert_eq!(layer.times_secs(), times, "{name}");
        for (frame, points) in points.chunks_exact(points.len() / times.len()).enumerate() {
            let groom = layer.frame(frame).unwrap();
            assert_eq!(groom.strand_count(), 42, "{name}");
            assert_eq!(groom.particle_count() * 3, points.len(), "{name}");
            for (particle, (p, wanted)) in groom.positions().iter().zip(points.chunks_exact(3)).enumerate() {
                let wanted = Vec3::new(wanted[0] as f32, wanted[1] as f32, wanted[2] as f32);
                // The B-spline's inner control points are not on the curve.
                let is_inner = particle > 200 && ![203, 204, 206].contains(&particle);
                assert!(is_inner || p.distance(wanted) < 1e-4, "{name} {frame} {particle}: {p} {wanted}");
            }
            let widths = groom.widths.unwrap();
            assert!([0, 1].iter().all(|&i| (widths[i] - [0.5, 0.25][i]).abs() < 1e-6), "{name}: {widths:?}");
            assert_eq!((widths[200], widths[206]), (1.0, 0.5), "{name}");
        }
        // The other prim has no colours, so the joined groom has none.
        assert_eq!(layer.frame(0).unwrap().colours, None);
        let import = layer.import(&Import::default());
        assert_eq!(import, Import { unit: Unit::Metre, up: Up::Z, scale: 0.01 });
    }
}

#[test]
fn primvars_of_the_library_are_spread() {
    let wanted = npz::read(Cursor::new(OF_PXR)).unwrap();
    let Data::F32(colours) = &wanted["colours"].data else { panic!("the colours are float32") };
    // The layer without its other prim, which has no colours.
    let mut bytes = BY_PXR[0].1.to_vec();
    let at = bytes.windows(24).position(|w| w == b"def BasisCurves \"short\"\n").unwrap();
    bytes[at..at + 15].copy_from_slice(b"def NurbsCurves");
    let groom = read(&bytes).unwrap();
    for (strand, colour) in colours.chunks_exact(3).enumerate() {
        assert_eq!(groom.colours.as_ref().unwrap()[5 * strand + 4], colour);
    }
    assert!(groom.transparencies.unwrap().iter().all(|&t| t == 0.25));
    assert_eq!(groom.root_uvs.unwrap()[39], [0.975, 0.5]);
}

/// What a layer holds of `groom`.
fn held(mut groom: Groom) -> Groom {
    for t in groom.transparencies.iter_mut().flatten() {
        *t = 1.0 - (1.0 - *t);
    }
    groom
}

proptest! {
    #[test]
    fn grooms_round_trip(groom in grooms()) {
        let wanted = held(groom.clone());
        prop_assert_eq!(&read(&usd::write_text(&groom)).unwrap(), &wanted);
        prop_assert_eq!(&read(&usd::write_binary(&groom)).unwrap(), &wanted);
    }

    #[test]
    fn random_bytes_never_panic(mut bytes in prop::collection::vec(any::<u8>(), 0..400), dress in 0usize..4) {
        let own = usd::write_binary(&Groom::from_strands([[Vec3::ZERO, Vec3::Y]]).unwrap());
        let beginnings: [&[u8]; 4] = [b"", b"#usda 1.0\ndef BasisCurves \"a\" {", &own[..88], &own[..400]];
        bytes.splice(..0, beginnings[dress].iter().copied());
        let _ = read(&bytes);
    }

    #[test]
    fn random_words_never_panic(text in "([(){}\\[\\]=,:\"<>@#. 0-9a-z-]|def |points|None|timeSamples|variantSet){0,60}") {
        let _ = read(format!("#usda 1.0\n{text}").as_bytes());
        let _ = read(format!("#usda 1.0\ndef BasisCurves \"a\" {{ point3f[] points = {text}").as_bytes());
    }
}

/// A generator of numbers below `most`.
fn numbers() -> impl FnMut(usize) -> usize {
    let mut state = 0x2545_f491_4f6c_dd1du64;
    move |most| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as usize % most.max(1)
    }
}

/// Bytes are changed, doubled words are written over, and ends are cut off.
#[test]
fn damaged_layers_never_panic() {
    let own = own_layers();
    let mut next = numbers();
    let layers = BY_PXR.iter().map(|(_, bytes)| *bytes).chain(own.iter().map(Vec::as_slice));
    let (mut refused, mut read_anyway) = (0, 0);
    for bytes in layers {
        for _ in 0..400 {
            let mut damaged = bytes.to_vec();
            for _ in 0..=next(3) {
                let at = next(damaged.len());
                match next(4) {
                    0 => damaged[at] ^= 1 << next(8),
                    1 => damaged[at] = [0, 1, 0x7f, 0x80, 0xff][next(5)],
                    2 => damaged[at..].iter_mut().take(4).for_each(|b| *b = 0xff),
                    // The tables are at the end.
                    _ => {
                        let at = damaged.len() - 1 - next(damaged.len().min(900));
                        damaged[at] = next(256) as u8;
                    }
                }
            }
            if next(8) == 0 {
                damaged.truncate(next(damaged.len()));
            }
            match read(&damaged) {
                Ok(_) => read_anyway += 1,
                Err(words) => {
                    assert!(!words.is_empty());
                    refused += 1;
                }
            }
        }
    }
    eprintln!("{refused} damaged layers were refused, {read_anyway} were read");
    assert!(refused > 500, "{refused}");
}

/// A groom in text and in binary, and a cache.
fn own_layers() -> [Vec<u8>; 3] {
    let line = |x: f32| (0..4).map(move |i| Vec3::new(x, 0.1 * i as f32, 0.0)).collect::<Vec<_>>();
    let mut groom = Groom::from_strands([line(0.0), line(1.0), line(2.0)]).unwrap();
    groom.widths = Some(vec![0.1; 12]);
    groom.colours = Some(vec![[0.5; 3]; 12]);
    groom.root_uvs = Some(vec![[0.25, 0.75]; 3]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.usdc");
    let mut writer = UsdCacheWriter::create(&path, &groom, 30.0).unwrap();
    for frame in 0..3 {
        writer.append(frame as f64, groom.positions(), None).unwrap();
    }
    writer.finish().unwrap();
    [usd::write_text(&groom), usd::write_binary(&groom), fs::read(&path).unwrap()]
}

#[test]
fn every_truncation_is_an_error_that_says_where() {
    for bytes in own_layers() {
        read(&bytes).unwrap();
        // The last line break of a text is not missed.
        for length in 0..bytes.len() - 1 {
            let words = read(&bytes[..length]).expect_err("a layer that was cut was read");
            assert!(words.contains("byte ") || words.contains("line "), "{words}");
        }
    }
}

#[test]
fn huge_counts_are_refused_before_memory_is_taken() {
    let [_, bytes, _] = own_layers();
    let contents = u64::from_le_bytes(bytes[16..24].try_into().unwrap()) as usize;
    // The first numbers of each section.
    for section in 0..6 {
        let entry = contents + 8 + 32 * section;
        let start = u64::from_le_bytes(bytes[entry + 16..entry + 24].try_into().unwrap()) as usize;
        for (at, count) in [(0, u64::MAX), (0, 1 << 40), (0, 1 << 33), (8, u64::MAX), (8, 1 << 40)] {
            let mut damaged = bytes.clone();
            damaged[start + at..start + at + 8].copy_from_slice(&count.to_le_bytes());
            // The words of STRINGS are not used.
            let result = read(&damaged);
            assert!(section == 1 && at == 8 || result.is_err(), "{section} {at} {count}");
        }
    }
    let mut damaged = bytes.clone();
    damaged[contents..contents + 8].copy_from_slice(&u64::MAX.to_le_bytes());
    assert!(read(&damaged).unwrap_err().contains("table of contents"));
}

#[test]
fn nesting_is_bounded() {
    let deep = |n: usize| format!("#usda 1.0\n{}{}", "def Xform \"a\" {\n".repeat(n), "}\n".repeat(n));
    assert!(read(deep(200).as_bytes()).unwrap_err().contains("no BasisCurves"));
    assert!(read(deep(100_000).as_bytes()).unwrap_err().contains("nested deeper than 256"));
    let brackets = format!("#usda 1.0\ndef A \"a\" {{ int[] x = {}", "[".repeat(1_000_000));
    assert!(read(brackets.as_bytes()).unwrap_err().contains("line 2"));
}

#[test]
fn errors_say_what_to_do() {
    for (text, words) in [
        ("PK\u{3}\u{4}", "unpack it"),
        ("#usdb 1.0", "begins neither with `#usda` nor with `PXR-USDC`"),
        ("#usda 1.0\ndef Mesh \"a\" {}", "usdcat --flatten"),
        ("#usda 1.0\ndef BasisCurves \"a\" {\nint[] x = [1, b]\n}", "line 3: `b` is no value of this type"),
        (
            "#usda 1.0\ndef BasisCurves \"a\" {\nint[] curveVertexCounts = [3]\n}",
            "add up to 3, but there are 0",
        ),
        ("#usda 1.0\n(metersPerUnit = 0)\ndef BasisCurves \"a\" {}", "`metersPerUnit` is 0"),
    ] {
        let error = read(text.as_bytes()).unwrap_err();
        assert!(error.contains(words), "{text}: {error}");
    }
}

#[test]
fn units_and_axes_of_the_layer_hold_unless_the_user_says_otherwise() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.usd");
    let curves = "def BasisCurves \"a\" { uniform token type = \"linear\"\nint[] curveVertexCounts = [2]\n\
                  point3f[] points = [(0, 0, 0), (1, 2, 3)]\nfloat[] widths = [0.5] }";
    let user = Import { unit: Unit::Millimetre, scale: 2.0, ..Import::default() };
    let z = Import { up: Up::Z, ..Import::default() };
    for (metadata, import, tip, metres) in [
        ("", Import::default(), Vec3::new(1.0, 2.0, 3.0), 0.01),
        ("(metersPerUnit = 1)", Import::default(), Vec3::new(1.0, 2.0, 3.0), 1.0),
        ("(metersPerUnit = 1\nupAxis = \"Z\")", Import::default(), Vec3::new(1.0, 3.0, -2.0), 1.0),
        ("(metersPerUnit = 0.0254)", z, Vec3::new(1.0, 3.0, -2.0), 0.0254),
        ("(upAxis = \"Z\")", user, Vec3::new(1.0, 3.0, -2.0), 0.002),
    ] {
        fs::write(&path, format!("#usda 1.0\n{metadata}\n{curves}")).unwrap();
        let groom = read_groom(&path, &import).unwrap().groom;
        assert!(groom.positions()[1].distance(tip * metres) < 1e-6 * metres, "{metadata}");
        assert!((groom.widths.unwrap()[1] - 0.5 * metres).abs() < 1e-7, "{metadata}");
    }
}

#[test]
fn cubic_curves_give_points_on_the_curve() {
    let curve = |basis: &str| {
        let text = format!(
            "def BasisCurves \"a\" {{ uniform token basis = \"{basis}\"\nint[] curveVertexCounts = [4]\n\
             point3f[] points = [(0, 0, 0), (27, 0, 0), (27, 27, 0), (0, 27, 0)] }}"
        );
        layer(&text).frame(0).unwrap().positions().to_vec()
    };
    let corner = |x, y| Vec3::new(x, y, 0.0);
    assert_eq!(curve("catmullRom")[1..3], [corner(27.0, 0.0), corner(27.0, 27.0)]);
    assert_eq!(curve("bspline")[..2], [corner(0.0, 0.0), corner(22.5, 4.5)]);
    assert_eq!(curve("bezier"), [corner(0.0, 0.0), corner(18.0, 7.0), corner(18.0, 20.0), corner(0.0, 27.0)]);
}

#[test]
fn other_prims_and_features_are_skipped() {
    let text = r#"( "a text with # and }"
        subLayers = [@./a.usd@ (offset = 1; scale = 2), @b.usd@]
        customLayerData = { dictionary a = { string b = "]" } } )
    class "c" { def BasisCurves "no" {} }
    over "o" { def BasisCurves "no" {} }
    def Xform "x" ( active = false ) { def BasisCurves "no" {} }
    def Xform "y" (
        prepend references = @other.usda@</a/b> (offset = 3)
        variants = { string v = "one" }
        prepend variantSets = "v"
    ) {
        variantSet "v" = { "one" { def BasisCurves "no" {} } }
        rel material:binding = </m> ( bindMaterialAs = "weaker" )
        double3 xformOp:translate = (0, 0, 1)
        uniform token[] xformOpOrder = ["!resetXformStack!", "xformOp:translate"]
        reorder properties = ["a"]
        def BasisCurves "yes" {
            custom asset file = @a "quoted" path@
            token outputs:out.connect = </m.outputs:out>
            int[] curveVertexCounts = [1, 2]; point3d[] points = [(1, 2, 3), (-1e1, 0, +.5), (0,0,0),]
            half[] widths = [1, 2,] ( interpolation = "uniform" )
            string a = """one "two"
            three""" # a comment
            add rel b = [</a>, </b>]
        }
    }"#;
    let groom = layer(text).frame(0).unwrap();
    assert_eq!(groom.strand_offsets(), [0, 1, 3]);
    assert_eq!(groom.positions()[0], Vec3::new(1.0, 2.0, 4.0));
    assert_eq!(groom.positions()[1], Vec3::new(-10.0, 0.0, 1.5));
    assert_eq!(groom.widths, Some(vec![1.0, 2.0, 2.0]));
}

#[test]
fn files_are_written_by_their_ending() {
    let folder = tempfile::tempdir().unwrap();
    let groom = Groom::from_strands([[Vec3::ZERO, Vec3::Y]]).unwrap();
    for (ending, magic) in [("usda", b"#usda 1."), ("usdc", b"PXR-USDC"), ("USD", b"PXR-USDC")] {
        let path = folder.path().join(format!("a.{ending}"));
        write_groom(&path, &groom).unwrap();
        assert_eq!(&fs::read(&path).unwrap()[..8], magic);
        assert_eq!(read_groom(&path, &Import::default()).unwrap().groom, groom);
    }
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn a_cache_can_be_read_while_it_grows() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hair.usdc");
    let groom = Groom::from_strands([vec![Vec3::ZERO, Vec3::Y], vec![Vec3::X; 3]]).unwrap();
    let frame = |f: usize| (0..5).map(|p| Vec3::new(f as f32, p as f32, 0.5)).collect::<Vec<_>>();
    let mut writer = UsdCacheWriter::create(&path, &groom, 60.0).unwrap();
    for f in 0..40 {
        assert_eq!(names(folder.path()), ["hair.usdc.lock", "hair.usdc.part"]);
        // What a process that is killed here leaves.
        let part = fs::read(folder.path().join("hair.usdc.part")).unwrap();
        match Usd::open(Cursor::new(part)) {
            Ok(layer) => {
                assert_eq!(layer.times_secs().len(), f / 16 * 16);
                assert_eq!(layer.frame(f / 16 * 16 - 1).unwrap().positions(), frame(f / 16 * 16 - 1));
            }
            Err(error) => {
                assert!(f < 16, "{error}");
                assert!(error.to_string().contains("was not completed"), "{error}");
            }
        }
        writer.append(f as f64 / 60.0, &frame(f), Some(&frame(f + 1))).unwrap();
    }
    let error = writer.append(0.1, &frame(0), Some(&frame(0))).unwrap_err().to_string();
    assert!(error.contains("not after the one before"), "{error}");
    assert!(writer.append(1.0, &frame(0), None).unwrap_err().to_string().contains("velocities"));
    assert!(writer.append(1.0, &frame(0)[1..], None).unwrap_err().to_string().contains("4 positions"));
    assert!(matches!(UsdCacheWriter::create(&path, &groom, 60.0), Err(WriteError::Locked { .. })));
    writer.checkpoint().unwrap();
    assert_eq!(names(folder.path()), ["hair.usdc", "hair.usdc.lock"]);
    writer.append(40.0 / 60.0, &frame(40), Some(&frame(41))).unwrap();
    writer.finish().unwrap();
    assert_eq!(names(folder.path()), ["hair.usdc"]);
    let layer = Usd::open(File::open(&path).unwrap()).unwrap();
    assert_eq!(layer.times_secs(), (0..41).map(|f| f as f64 / 60.0).collect::<Vec<_>>());
    for f in 0..41 {
        assert_eq!(layer.frame(f).unwrap().positions(), frame(f));
    }
    assert_eq!(layer.frame(3).unwrap().strand_offsets(), groom.strand_offsets());
    assert!(layer.frame(41).unwrap_err().to_string().contains("no frame 41"));
    let import = layer.import(&Import { up: Up::Y, ..Import::default() });
    let mut groom = layer.frame(1).unwrap();
    import.apply(&mut groom, ZUp::Common);
    assert_eq!(groom.positions(), frame(1));
}

#[test]
fn a_cache_that_is_dropped_leaves_the_old_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hair.usdc");
    fs::write(&path, "old").unwrap();
    let groom = Groom::from_strands([[Vec3::ZERO, Vec3::Y]]).unwrap();
    let mut writer = UsdCacheWriter::create(&path, &groom, 24.0).unwrap();
    writer.append(0.0, groom.positions(), None).unwrap();
    drop(writer);
    assert_eq!(names(folder.path()), ["hair.usdc"]);
    assert_eq!(fs::read(&path).unwrap(), b"old");
    assert!(UsdCacheWriter::create(&path, &Groom::default(), 24.0).is_err());
    assert!(UsdCacheWriter::create(&path, &groom, 0.0).is_err());
}

#[test]
fn a_cache_goes_on_after_the_frames_that_are_stored() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hair.usdc");
    let groom = Groom::from_strands([[Vec3::ZERO, Vec3::Y], [Vec3::X, Vec3::Z]]).unwrap();
    let frame = |f: usize| (0..4).map(|p| Vec3::new(f as f32, p as f32, 0.5)).collect::<Vec<_>>();
    let fill = |writer: &mut UsdCacheWriter, frames: std::ops::Range<usize>| {
        for f in frames {
            writer.append(f as f64 / 24.0, &frame(f), Some(&frame(2 * f))).unwrap();
        }
    };
    let resume = |groom: &Groom, rate, stored: &Stored| UsdCacheWriter::resume(&path, groom, rate, stored);
    assert!(matches!(resume(&groom, 24.0, &Stored::default()), Err(WriteError::Resume { .. })));
    let mut writer = UsdCacheWriter::create(&path, &groom, 24.0).unwrap();
    fill(&mut writer, 0..5);
    let checksum = writer.checkpoint().unwrap();
    let stored = Stored { times_secs: (0..5).map(|f| f as f64 / 24.0).collect(), checksum };
    // Frames after the checkpoint are not kept.
    fill(&mut writer, 5..30);
    drop(writer);

    let before = fs::read(&path).unwrap();
    let other = Groom::from_strands([[Vec3::ZERO; 4]]).unwrap();
    let wrong = Stored { checksum: checksum ^ 1, ..stored.clone() };
    let late = Stored { times_secs: stored.times_secs.iter().map(|t| t + 1.0).collect(), checksum };
    for (groom, rate, stored, words) in [
        (&other, 24.0, &stored, "other strands"),
        (&groom, 25.0, &stored, "24 frames per second in place of 25"),
        (&groom, 24.0, &wrong, "does not hold the frames"),
        (&groom, 24.0, &late, "times of `points`"),
    ] {
        let error = resume(groom, rate, stored).err().unwrap().to_string();
        assert!(error.contains(words), "{error}");
    }
    assert_eq!(fs::read(&path).unwrap(), before);

    for frames in [7, 20] {
        let mut writer = resume(&groom, 24.0, &stored).unwrap();
        assert_eq!(Usd::open(File::open(&path).unwrap()).unwrap().times_secs().len(), 5);
        fill(&mut writer, 5..frames);
        let checksum = writer.finish().unwrap();
        let bytes: Vec<u8> = (0..frames).flat_map(|f| bytemuck::cast_slice(&frame(f)).to_vec()).collect();
        assert_eq!(checksum, crc32fast::hash(&bytes));
        let layer = Usd::open(File::open(&path).unwrap()).unwrap();
        assert_eq!(layer.times_secs().len(), frames);
        for f in 0..frames {
            assert_eq!(layer.frame(f).unwrap().positions(), frame(f));
        }
    }
}

/// The bytes that are read from a file.
struct Counted<'a> {
    file: Cursor<&'a [u8]>,
    read: &'a Cell<u64>,
}

impl Read for Counted<'_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let read = self.file.read(out)?;
        self.read.set(self.read.get() + read as u64);
        Ok(read)
    }
}

impl Seek for Counted<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

/// The list of samples is not read anew for each frame: that would take time by the square of their
/// number.
#[test]
fn all_frames_take_little_more_than_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.usdc");
    let groom = Groom::from_strands([[Vec3::ZERO, Vec3::Y]]).unwrap();
    let mut writer = UsdCacheWriter::create(&path, &groom, 24.0).unwrap();
    for frame in 0..1000u16 {
        let points = [Vec3::ZERO, Vec3::Y * f32::from(frame)];
        writer.append(f64::from(frame) / 24.0, &points, None).unwrap();
    }
    writer.finish().unwrap();
    let bytes = fs::read(&path).unwrap();
    let read = Cell::new(0);
    let layer = Usd::open(Counted { file: Cursor::new(&bytes), read: &read }).unwrap();
    for frame in 0..layer.times_secs().len() {
        layer.frame(frame).unwrap();
    }
    assert_eq!(layer.times_secs().len(), 1000);
    assert!(read.get() < 4 * bytes.len() as u64, "{} of {}", read.get(), bytes.len());
}

#[test]
fn labels_beyond_32_bits_are_refused() {
    for (kind, ids, found) in [
        ("int64", "7, -8", Ok(vec![7, -8])),
        ("int64", "7, 5000000000", Err("strand 1 is 5000000000")),
        ("uint", "3000000000, 1", Err("strand 0 is 3000000000")),
    ] {
        let text = format!(
            "#usda 1.0\ndef BasisCurves \"a\" {{\n int[] curveVertexCounts = [2, 2]\n point3f[] points = \
             [(0, 0, 0), (0, 1, 0), (1, 0, 0), (1, 1, 0)]\n {kind}[] primvars:groom_id = [{ids}]\n}}"
        );
        match (read(text.as_bytes()), found) {
            (Ok(groom), Ok(ids)) => assert_eq!(groom.labels.ids, Some(ids)),
            (Err(error), Err(words)) => {
                assert!(error.contains(&format!("`primvars:groom_id` of {words}")), "{error}");
            }
            (own, _) => panic!("{own:?}"),
        }
    }
}
