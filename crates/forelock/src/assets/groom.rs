//! The strands of a scene: read or grown, repaired, resampled, brought out of the body.

use std::path::PathBuf;

use forelock_core::body::Walker;
use forelock_core::groom::edit::{self, Edit, EditError, EditReport};
use forelock_core::groom::grow;
use forelock_core::groom::{Groom, Labels, LiftParams, LiftReport, lift_out, resample, resample_to};
use forelock_core::memory;
use forelock_core::meter::Meter;
use glam::{DVec3, Vec3};

use super::character::box_of;
use super::solids::Body;
use super::{AssetError, neck};
use crate::scene::{GroomSource, Scene};

/// The least memory that a particle takes while strands are grown or resampled, bytes.
const GROWN_BYTES: u64 = 28;

/// The groom of `scene` on `body`; what was changed is added to `notes`.
pub(super) fn load(
    scene: &Scene,
    body: Option<&Body>,
    notes: &mut Vec<String>,
    meter: &Meter,
) -> Result<Groom, AssetError> {
    let section = &scene.groom;
    let remedy = "lower the number of strands or of their particles";
    memory::check("the groom", section.grown_particles(), GROWN_BYTES, remedy)?;
    let mut groom = match (&section.source, body) {
        (GroomSource::Files(files), _) => {
            let mut grooms = Vec::with_capacity(files.len());
            for path in files {
                let imported = forelock_io::read_groom(path, &section.import())?;
                let repairs = imported.repairs.sentences();
                notes.extend(repairs.into_iter().map(|repair| format!("{}: {repair}", path.display())));
                grooms.push(imported.groom);
            }
            if grooms.len() == 1 { grooms.swap_remove(0) } else { join(files, grooms, notes)? }
        }
        (GroomSource::Grow, Some(body)) => grow_on(scene, body, meter)?,
        (GroomSource::Grow, None) => return Err(grow::GrowError::EmptyRegion.into()),
    };
    if let (GroomSource::Files(_), Some(body)) = (&section.source, body) {
        notes.extend(misfit(&groom, body));
    }
    let count = section.vertices_per_strand as usize;
    if count > 0 {
        groom = resample(&groom, count)?;
    }
    if section.vertices > 0 {
        let (vertices, strands) = (section.vertices as usize, groom.strand_count());
        if vertices < 2 * strands || vertices > 1000 * strands {
            return Err(AssetError::Vertices { vertices, strands });
        }
        groom = resample_to(&groom, vertices)?;
        // A thousand a strand is what solvers are made for; on average there are no more.
        if let Some(strand) = (0..strands).find(|&s| groom.strand(s).len() > 1000) {
            return Err(AssetError::Uneven { strand, particles: groom.strand(strand).len() });
        }
    }
    // Growth keeps out of the body by itself.
    let lift = section.lift && section.source != GroomSource::Grow;
    if let Some(sdf) = body.and_then(|body| body.sdf.as_ref()).filter(|_| lift) {
        let (margin, clamped) = skin(scene);
        let params = LiftParams { margin, clamped, ..LiftParams::default() };
        let report = lift_out(&mut groom, sdf, &params);
        if report != LiftReport::default() {
            notes.push(report.to_string());
        }
    }
    Ok(groom)
}

/// The strands of `grooms`, which are those of `files`.
fn join(files: &[PathBuf], mut grooms: Vec<Groom>, notes: &mut Vec<String>) -> Result<Groom, AssetError> {
    let mut labels: Vec<&mut Labels> = grooms.iter_mut().map(|groom| &mut groom.labels).collect();
    for changed in Labels::tell_apart(&mut labels) {
        let path = files[changed].display();
        notes.push(format!(
            "{path}: its strands were given new IDs, because another file uses some of the same"
        ));
    }
    Ok(Groom::join(&grooms)?)
}

/// What to say of a groom that is much larger or smaller than the body, or far from it.
fn misfit(groom: &Groom, body: &Body) -> Option<String> {
    let [low, high] = box_of(groom.positions().iter().copied());
    let (from, to) = body.mesh.bounds();
    let (hair, own) = (low.distance(high), from.distance(to));
    let apart = (low - to).max(from - high).max(Vec3::ZERO).length();
    let problem = if hair > 10.0 * own || 100.0 * hair < own {
        format!("the groom is {hair:.3} m across, the body {own:.3} m")
    } else if apart > own {
        format!("the groom is {apart:.2} m away from the body")
    } else {
        return None;
    };
    Some(format!("{problem}: `groom.unit`, `groom.scale` and `groom.up` say how files are read"))
}

/// How far over the skin the solver of `scene` keeps hair, metres, and how many particles of a
/// strand it holds there.
fn skin(scene: &Scene) -> (f32, usize) {
    (scene.solver.skin_thickness() as f32, scene.solver.clamped() as usize)
}

/// Does `edit` to `groom`, which keeps out of `body` as far as the solver of `scene` asks for.
pub(super) fn edit(
    edit: &Edit,
    scene: &Scene,
    groom: &mut Groom,
    body: Option<&Body>,
) -> Result<EditReport, EditError> {
    let solid = body.and_then(|body| {
        let (sdf, mesh) = (body.sdf.as_deref()?, Some(body.mesh.as_ref()));
        Some(edit::Body { sdf, mesh, margin: skin(scene).0 })
    });
    edit.apply(groom, solid.as_ref())
}

fn grow_on(scene: &Scene, body: &Body, meter: &Meter) -> Result<Groom, AssetError> {
    let params = &scene.groom.grow;
    // At rest the talker is the head.
    if ["builtin:head", "builtin:talker"].contains(&scene.body.mesh.as_str()) {
        return Ok(grow::grow_on_head_watched(params, meter)?);
    }
    let weights: Vec<f32> = match scene.groom.region_box {
        None if scene.body.mesh != "builtin:walker" => vec![1.0; body.mesh.positions.len()],
        corners => {
            let corners = corners.map(|own| own.map(|corner| DVec3::from_array(corner).as_vec3()));
            let [a, b] = corners.unwrap_or(Walker::SCALP);
            let (lo, hi) = (a.min(b), a.max(b));
            let inside = |p: &Vec3| p.cmpge(lo).all() && p.cmple(hi).all();
            if !body.mesh.positions.iter().any(inside) {
                let (low, high) = body.mesh.bounds();
                return Err(AssetError::EmptyBox(low, high));
            }
            body.mesh.positions.iter().map(|p| if inside(p) { 1.0 } else { 0.0 }).collect()
        }
    };
    let field = body.sdf.as_deref();
    let avoid = |p: Vec3, reach: f32| {
        let (distance, gradient) = field?.sample_near(p, reach)?;
        Some((distance, gradient.normalize_or_zero()))
    };
    let avoid = field.map(|_| &avoid as &grow::Avoid<'_>);
    Ok(grow::grow_watched(&body.mesh, &weights, params, avoid, meter)?)
}

/// About where hair without a body turns.
pub(super) fn middle_of_roots(groom: &Groom) -> DVec3 {
    let roots = groom.strands().filter_map(|strand| strand.first());
    let [lo, hi] = box_of(roots.copied());
    neck(lo.as_dvec3(), hi.as_dvec3())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two files that number their strands from 0: each strand follows a guide of its own file.
    #[test]
    fn strands_of_joined_files_follow_their_own_guides() {
        let strand = |x: f32| [Vec3::X * x, Vec3::X * (x + 1.0)];
        let mut groom = Groom::from_strands([strand(0.0), strand(1.0)]).unwrap();
        groom.labels.ids = Some(vec![0, 1]);
        groom.labels.closest_guides = Some(vec![[0, -1, -1]; 2]);
        let files = ["scalp.abc", "brows.abc"].map(PathBuf::from);
        let mut notes = Vec::new();
        let joined = join(&files, vec![groom.clone(), groom], &mut notes).unwrap();
        assert_eq!(joined.labels.ids, Some(vec![0, 1, 2, 3]));
        let guides = joined.labels.closest_guides.unwrap();
        assert_eq!(guides.iter().map(|own| own[0]).collect::<Vec<_>>(), [0, 0, 2, 2]);
        assert!(notes.len() == 1 && notes[0].starts_with("brows.abc: "), "{notes:?}");
    }
}
