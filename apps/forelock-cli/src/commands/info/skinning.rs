//! Skinning files of TressFX.

use std::collections::HashSet;

use forelock_io::tfx_skin::{BoneSkin, Skinning, TriangleSkin};
use serde::Serialize;

use super::character::listed;
use crate::arguments::InfoArgs;
use crate::terminal;

#[derive(Serialize)]
struct TriangleReport {
    file: String,
    format: &'static str,
    strands: usize,
    /// Meshes that strands grow on.
    meshes: usize,
    /// Triangles that strands grow on.
    triangles: usize,
    /// The largest index of a triangle.
    last_triangle: u32,
    /// Strands whose roots are not in their triangle.
    outside: usize,
    has_root_uvs: bool,
}

#[derive(Serialize)]
struct BoneReport {
    file: String,
    format: &'static str,
    strands: usize,
    bones: Vec<String>,
    /// Bones that a strand follows, at most.
    influences: usize,
    /// Strands whose weights do not sum to 1.
    unbalanced: usize,
}

/// Prints a description of a `.tfxskin` or `.tfxbone` file.
pub fn describe(arguments: &InfoArgs) -> anyhow::Result<()> {
    let file = arguments.file.display().to_string();
    match forelock_io::read_skinning(&arguments.file)? {
        Skinning::Triangles(skin) => describe_triangles(file, &skin, arguments.json),
        Skinning::Bones(skin) => describe_bones(file, skin, arguments.json),
    }
}

fn describe_triangles(file: String, skin: &TriangleSkin, json: bool) -> anyhow::Result<()> {
    let places: HashSet<(u32, u32)> = skin.roots.iter().map(|root| (root.mesh, root.triangle)).collect();
    let meshes: HashSet<u32> = places.iter().map(|place| place.0).collect();
    let report = TriangleReport {
        file,
        format: "TressFX skinning by triangles",
        strands: skin.roots.len(),
        meshes: meshes.len(),
        triangles: places.len(),
        last_triangle: places.iter().map(|place| place.1).max().unwrap_or_default(),
        outside: skin.outside(),
        has_root_uvs: skin.root_uvs.is_some(),
    };
    if json {
        return terminal::json(&report);
    }
    terminal::line(format!("{}: {}", report.file, report.format))?;
    let uvs = if report.has_root_uvs { "with" } else { "without" };
    terminal::line(format!(
        "{} strands on {} triangles of {} meshes, the last triangle {}; {uvs} root UVs",
        report.strands, report.triangles, report.meshes, report.last_triangle
    ))?;
    if report.outside > 0 {
        terminal::line(format!("note: {} roots are not in their triangle", report.outside))?;
    }
    terminal::line("a run does not use it: it binds the roots to the body itself")
}

fn describe_bones(file: String, skin: BoneSkin, json: bool) -> anyhow::Result<()> {
    let unbalanced = skin.unbalanced();
    let followed = skin.strands.iter().map(|own| own.iter().filter(|pair| pair.weight != 0.0).count());
    let report = BoneReport {
        file,
        format: "TressFX skinning by bones",
        strands: skin.strands.len(),
        influences: followed.max().unwrap_or_default(),
        bones: skin.bones.into_iter().map(|bone| bone.1).collect(),
        unbalanced,
    };
    if json {
        return terminal::json(&report);
    }
    terminal::line(format!("{}: {}", report.file, report.format))?;
    terminal::line(format!(
        "{} strands, at most {} bones a strand; {} bones: {}",
        report.strands,
        report.influences,
        report.bones.len(),
        listed(&report.bones)
    ))?;
    if unbalanced > 0 {
        terminal::line(format!("note: the weights of {unbalanced} strands do not sum to 1"))?;
    }
    terminal::line("a run does not use it: it binds the roots to the body itself")
}
