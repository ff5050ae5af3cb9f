//! Characters and motions.

use forelock_io::{Format, ImportedCharacter};
use serde::Serialize;

use crate::arguments::InfoArgs;
use crate::terminal;

/// Names that are printed of a long list.
const PRINTED: usize = 40;

#[derive(Serialize)]
struct CharacterReport {
    file: String,
    format: String,
    vertices: usize,
    triangles: usize,
    /// Bones that a vertex follows, at most.
    influences: usize,
    /// The smallest box around the mesh at rest, metres.
    min: [f32; 3],
    max: [f32; 3],
    joints: Vec<String>,
    meshes: Vec<Mesh>,
    blend_shapes: Vec<String>,
    clips: Vec<ClipReport>,
    notes: Vec<String>,
}

#[derive(Serialize)]
struct Mesh {
    name: String,
    triangles: usize,
}

#[derive(Serialize)]
struct ClipReport {
    name: String,
    secs: f64,
    tracks: usize,
}

#[derive(Serialize)]
struct MotionReport {
    file: String,
    format: &'static str,
    frames: usize,
    fps: f64,
    secs: f64,
    /// Height of the skeleton at rest, in the file's unit.
    height: f64,
    joints: Vec<String>,
}

/// The first names of a list.
pub(super) fn listed(names: &[String]) -> String {
    let more = names.len().saturating_sub(PRINTED);
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    format!("{}{more}", names[..names.len().min(PRINTED)].join(", "))
}

/// Prints a description of the character that the file holds.
pub fn describe_character(arguments: &InfoArgs, imported: ImportedCharacter) -> anyhow::Result<()> {
    let format = match Format::of(&arguments.file) {
        Some(format) if format != Format::Gltf => format.to_string(),
        _ => "glTF 2.0".to_owned(),
    };
    let own = imported.character;
    let (min, max) = own.rest().bounds();
    let report = CharacterReport {
        file: arguments.file.display().to_string(),
        format,
        vertices: own.rest().positions.len(),
        triangles: own.rest().triangles.len(),
        influences: own.skin().influences(),
        min: min.to_array(),
        max: max.to_array(),
        joints: own.skeleton().joints().iter().map(|joint| joint.name.clone()).collect(),
        meshes: own
            .groups()
            .iter()
            .map(|group| Mesh { name: group.name.clone(), triangles: group.triangles.len() })
            .collect(),
        blend_shapes: own.shapes().iter().map(|shape| shape.name.clone()).collect(),
        clips: own
            .clips()
            .iter()
            .map(|clip| ClipReport {
                name: clip.name.clone(),
                secs: clip.duration_secs(),
                tracks: clip.tracks.len(),
            })
            .collect(),
        notes: imported.notes,
    };
    if arguments.json {
        return terminal::json(&report);
    }
    terminal::line(format!("{}: {}", report.file, report.format))?;
    let size = max - min;
    terminal::line(format!(
        "{} vertices, {} triangles, at most {} joints a vertex; {} m at rest",
        report.vertices,
        report.triangles,
        report.influences,
        sides(size.to_array())
    ))?;
    if size.max_element() > 10.0 || size.max_element() < 0.05 {
        terminal::line("that is no usual size in metres: set `body.unit` or `body.scale`")?;
    }
    for mesh in &report.meshes {
        terminal::line(format!("mesh {}: {} triangles", mesh.name, mesh.triangles))?;
    }
    terminal::line(format!("{} joints: {}", report.joints.len(), listed(&report.joints)))?;
    if !report.blend_shapes.is_empty() {
        let shapes = listed(&report.blend_shapes);
        terminal::line(format!("{} blend shapes: {shapes}", report.blend_shapes.len()))?;
    }
    for clip in &report.clips {
        terminal::line(format!("clip {}: {:.3} s, {} tracks", clip.name, clip.secs, clip.tracks))?;
    }
    for note in &report.notes {
        terminal::line(format!("note: {note}"))?;
    }
    Ok(())
}

fn sides([x, y, z]: [f32; 3]) -> String {
    format!("{x:.3} × {y:.3} × {z:.3}")
}

/// Prints a description of a `.bvh` file.
pub fn describe_motion(arguments: &InfoArgs) -> anyhow::Result<()> {
    let own = forelock_io::read_motion(&arguments.file)?;
    let heights = own.skeleton.rest_globals().into_iter().map(|global| global.translation.y);
    let (low, high) =
        heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), y| (low.min(y), high.max(y)));
    let report = MotionReport {
        file: arguments.file.display().to_string(),
        format: "Biovision hierarchy",
        frames: own.frames,
        fps: 1.0 / own.frame_secs,
        secs: own.clip.duration_secs(),
        height: high - low,
        joints: own.skeleton.joints().iter().map(|joint| joint.name.clone()).collect(),
    };
    if arguments.json {
        return terminal::json(&report);
    }
    terminal::line(format!("{}: {}", report.file, report.format))?;
    terminal::line(format!(
        "{} frames at {:.3} a second, {:.3} s; the skeleton is {:.3} units high",
        report.frames, report.fps, report.secs, report.height
    ))?;
    terminal::line(format!("{} joints: {}", report.joints.len(), listed(&report.joints)))
}
