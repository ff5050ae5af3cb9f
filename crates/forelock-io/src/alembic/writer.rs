//! Writing of a groom, at rest or in motion.
//!
//! # Theory
//! The archive has one object `hair` of the schema `AbcGeom_Curve_v2` with linear strands. Points,
//! bounds and velocities have one sample for each frame. Everything else has one stored sample that
//! all frames share. The time of frame i is t₀ + i / fps.
//!
//! # Practice
//! The attributes of Unreal's grooms, version 1.5, lie in `.arbGeomParams`: `groom_color`,
//! `groom_root_uv` and the labels. Widths are the schema's `width`.
//! Lengths are in metres, y up, and the metadata of the archive say so.
//!
//! # Limitations
//! Transparencies, pins, stiffness and root bindings are not written.

use std::io::{self, Cursor, Seek, Write};

use forelock_core::groom::Groom;
use glam::{DVec3, Vec3};

use super::{
    SCHEMA, UNIT_KEY, VERSION,
    hash::checksum,
    ogawa::Child,
    output::{Compound, Indexed, Kind, Output, Track, Type},
    times::TimeSampling,
};
use crate::labels::NAMES;

const POINTS: Kind = array("P", "geoScope=vtx;interpretation=point", Type::F32, 3);
const COUNTS: Kind = array("nVertices", "", Type::I32, 1);
const VELOCITIES: Kind = array(".velocities", "interpretation=vector", Type::F32, 3);
const WIDTHS: Kind =
    array("width", "arrayExtent=1;geoScope=vtx;isGeomParam=true;podExtent=1;podName=float32_t", Type::F32, 1);
const ROOT_UVS: Kind = array(
    "groom_root_uv",
    "arrayExtent=1;geoScope=uni;interpretation=vector;isGeomParam=true;podExtent=2;podName=float32_t",
    Type::F32,
    2,
);
const COLOURS: Kind = array(
    "groom_color",
    "arrayExtent=1;geoScope=vtx;interpretation=rgb;isGeomParam=true;podExtent=3;podName=float32_t",
    Type::F32,
    3,
);
const I32_STRANDS: &str = "arrayExtent=1;geoScope=uni;isGeomParam=true;podExtent=1;podName=int32_t";
const I16_STRANDS: &str = "arrayExtent=1;geoScope=uni;isGeomParam=true;podExtent=1;podName=int16_t";
const I32_GUIDES: &str =
    "arrayExtent=1;geoScope=uni;interpretation=vector;isGeomParam=true;podExtent=3;podName=int32_t";
const F32_GUIDES: &str =
    "arrayExtent=1;geoScope=uni;interpretation=vector;isGeomParam=true;podExtent=3;podName=float32_t";
const I16_CONSTANT: &str = "arrayExtent=1;geoScope=con;isGeomParam=true;podExtent=1;podName=int16_t";
const KINDS_OF_LABELS: [Kind; 5] = [
    array(NAMES[1], I32_STRANDS, Type::I32, 1),
    array(NAMES[2], I16_STRANDS, Type::I16, 1),
    array(NAMES[0], I32_STRANDS, Type::I32, 1),
    array(NAMES[3], I32_GUIDES, Type::I32, 3),
    array(NAMES[4], F32_GUIDES, Type::F32, 3),
];
const VERSIONS: [Kind; 2] = [
    array("groom_version_major", I16_CONSTANT, Type::I16, 1),
    array("groom_version_minor", I16_CONSTANT, Type::I16, 1),
];
const BOUNDS: Kind = scalar(".selfBnds", "interpretation=box", Type::F64, 6);
const BASIS: Kind = scalar("curveBasisAndType", "", Type::U8, 4);
/// The object and its metadata.
const NAME: &str = "hair";
const OBJECT_METADATA: &str =
    "schema=AbcGeom_Curve_v2;schemaBaseType=AbcGeom_GeomBase_v1;schemaObjTitle=AbcGeom_Curve_v2:.geom";
/// Linear, open, without basis.
const LINEAR: [u8; 4] = [1, 0, 0, 0];

const fn array(name: &'static str, metadata: &'static str, type_: Type, extent: u8) -> Kind {
    Kind { name, metadata, is_array: true, type_, extent }
}

const fn scalar(name: &'static str, metadata: &'static str, type_: Type, extent: u8) -> Kind {
    Kind { name, metadata, is_array: false, type_, extent }
}

/// The bytes of an archive with `groom` at rest.
///
/// # Errors
/// A message if the groom has no points, or an attribute does not match it.
pub fn write(groom: &Groom) -> Result<Vec<u8>, String> {
    check(groom)?;
    let write = || {
        let mut strands = Strands::new(Cursor::new(Vec::new()), groom)?;
        strands.push(groom.positions(), None)?;
        strands.finish(None)
    };
    write().map(Cursor::into_inner).map_err(|error: io::Error| error.to_string())
}

/// Checks that `groom` can be written.
pub(super) fn check(groom: &Groom) -> Result<(), String> {
    groom.check_attributes().map_err(|e| e.to_string())?;
    if groom.particle_count() == 0 {
        return Err("there are no points to write".into());
    }
    if i32::try_from(groom.particle_count()).is_err() {
        return Err("over 2,147,483,647 points, the limit of Alembic".into());
    }
    Ok(())
}

/// The times of the frames.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    pub start_secs: f64,
    pub fps: f64,
}

/// An archive of strands that is being written.
pub(super) struct Strands<W> {
    out: Output<W>,
    points: Track,
    bounds: Track,
    velocities: Track,
    /// The properties of the schema with one stored sample.
    constant: Vec<Track>,
    /// The properties that the schema does not know.
    others: Vec<Track>,
}

impl<W: Write + Seek> Strands<W> {
    pub fn new(file: W, groom: &Groom) -> io::Result<Self> {
        let mut out = Output::new(file)?;
        // The particles are fewer than 2³¹.
        let counts: Vec<i32> = (0..groom.strand_count()).map(|s| groom.range(s).len() as i32).collect();
        let labels = &groom.labels;
        let guides = labels.guides.as_ref().map(|g| g.iter().map(|&g| i16::from(g)).collect::<Vec<_>>());
        let mut tracks = |all: &[(Kind, Option<&[u8]>)]| -> io::Result<Vec<Track>> {
            let present = all.iter().filter_map(|&(kind, bytes)| Some((kind, bytes?)));
            let track = |(kind, bytes)| {
                let mut track = Track::new(kind);
                track.push(&mut out, bytes).map(|()| track)
            };
            present.map(track).collect()
        };
        let constant = tracks(&[
            (COUNTS, Some(bytemuck::cast_slice(&counts))),
            (BASIS, Some(&LINEAR)),
            (WIDTHS, groom.widths.as_deref().map(bytemuck::cast_slice)),
        ])?;
        let [group_ids, guide, ids, closest, weights] = KINDS_OF_LABELS;
        let [major, minor] = VERSIONS;
        let mut others = tracks(&[
            (COLOURS, groom.colours.as_deref().map(bytemuck::cast_slice)),
            (ROOT_UVS, groom.root_uvs.as_deref().map(bytemuck::cast_slice)),
            (group_ids, labels.group_ids.as_deref().map(bytemuck::cast_slice)),
            (guide, guides.as_deref().map(bytemuck::cast_slice)),
            (ids, labels.ids.as_deref().map(bytemuck::cast_slice)),
            (closest, labels.closest_guides.as_deref().map(bytemuck::cast_slice)),
            (weights, labels.guide_weights.as_deref().map(bytemuck::cast_slice)),
        ])?;
        if !others.is_empty() {
            let [one, five] = VERSION.map(i16::to_le_bytes);
            others.extend(tracks(&[(major, Some(&one)), (minor, Some(&five))])?);
        }
        let [points, bounds, velocities] = [POINTS, BOUNDS, VELOCITIES].map(Track::new);
        Ok(Self { out, points, bounds, velocities, constant, others })
    }

    /// Appends a frame. Either all frames have velocities, or none.
    pub fn push(&mut self, positions: &[Vec3], velocities: Option<&[Vec3]>) -> io::Result<()> {
        let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for position in positions {
            (min, max) = (min.min(position.as_dvec3()), max.max(position.as_dvec3()));
        }
        let bounds = [min.to_array(), max.to_array()];
        self.bounds.push(&mut self.out, bytemuck::cast_slice(&bounds))?;
        self.points.push(&mut self.out, bytemuck::cast_slice(positions))?;
        match velocities {
            Some(velocities) => self.velocities.push(&mut self.out, bytemuck::cast_slice(velocities)),
            None => Ok(()),
        }
    }

    /// Completes the archive, whose frames are at the times of `clock`. Without it there is one
    /// sample at time 0.
    pub fn finish(mut self, clock: Option<Clock>) -> io::Result<W> {
        let frames = self.points.count();
        let sampling = u8::from(clock.is_some());
        self.constant.iter_mut().chain(&mut self.others).for_each(|track| track.repeat_to(frames));
        let mut indexed = Indexed::default();
        let version = self.out.data(&[&0i32.to_le_bytes()])?;
        // The version of the library whose layout this is.
        let library = self.out.data(&[&10_803i32.to_le_bytes()])?;
        let top = self.objects(&mut indexed, sampling)?;
        let per_second = clock.map_or(String::new(), |clock| format!("FramesPerTimeUnit={};", clock.fps));
        let metadata = format!("{per_second}_ai_Application=Forelock;{UNIT_KEY}=m");
        let metadata = self.out.data(&[metadata.as_bytes()])?;
        let mut samplings = Vec::new();
        let still = TimeSampling { period_secs: 1.0, times_secs: vec![0.0] };
        still.write(if clock.is_some() { 0 } else { frames }, &mut samplings);
        if let Some(Clock { start_secs, fps }) = clock {
            let moving = TimeSampling { period_secs: 1.0 / fps, times_secs: vec![start_secs] };
            moving.write(frames, &mut samplings);
        }
        let samplings = self.out.data(&[&samplings])?;
        let indexed = self.out.data(&[&indexed.bytes()])?;
        let root = self.out.group(&[version, library, top, metadata, samplings, indexed])?;
        self.out.finish(root)
    }

    /// Writes the object `hair` and the top object.
    fn objects(&mut self, indexed: &mut Indexed, sampling: u8) -> io::Result<Child> {
        let mut properties = Compound::new(&mut self.out, indexed);
        let (constant, others) = (&self.constant, &self.others);
        properties.add_compound(".geom", SCHEMA, |geom| {
            let moving = [&self.bounds, &self.points, &self.velocities];
            let moving = moving.into_iter().filter(|track| track.count() > 0);
            moving.chain(constant).try_for_each(|track| geom.add(track, sampling))?;
            if others.is_empty() {
                return Ok(());
            }
            geom.add_compound(".arbGeomParams", "", |inner| {
                others.iter().try_for_each(|track| inner.add(track, sampling))
            })
        })?;
        let (properties, sum) = properties.finish()?;
        let own = self.out.data(&[&sum, &[0; 16]])?;
        let hair = self.out.group(&[properties, own])?;
        let mut header = (NAME.len() as u32).to_le_bytes().to_vec();
        header.extend(NAME.bytes());
        header.push(indexed.index(OBJECT_METADATA));
        let headers = self.out.data(&[&header, &checksum(&[]), &checksum(&sum)])?;
        self.out.group(&[Child(0), hair, headers])
    }
}
