//! What a drag in the picture does: looks around, moves the head, pushes the hair, or grooms it.
//!
//! # Practice
//! A brush works on the rest shape: the pointer picks the particle in front, and the edit is made
//! where that particle is at rest. So a brush does the same to hair that moves and to hair that
//! hangs.

use forelock::player::Moment;
use forelock::scene::ShapeKind;
use forelock_core::groom::edit::{
    Ball, Clump, Comb, Curl, Cut, CutShape, Density, Edit, Lengthen, Mirror, Operation, Pull, Selection,
    Smooth, Straighten, Stroke,
};
use forelock_render::Camera;
use glam::{Vec2, Vec3};

/// What a drag with the main button does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tool {
    /// Turns the camera.
    Look,
    /// Moves the head; with shift it turns.
    Head,
    /// Moves a solid through the hair.
    Push(ShapeKind),
    /// Grooms.
    Brush(Brush),
}

/// The brushes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Brush {
    /// Ends strands where the stroke crosses them.
    Cut,
    /// Turns hair along the stroke.
    Comb,
    /// Makes strands longer.
    Lengthen,
    /// Moves hair to the pointer.
    Attract,
    /// Moves hair away from it.
    Repel,
    /// Winds hair up.
    Curl,
    /// Removes curl.
    Straighten,
    /// Gathers locks.
    Clump,
    /// Adds strands.
    Thicken,
    /// Removes strands.
    Thin,
    /// Averages neighbours.
    Smooth,
    /// Makes the hair that is rooted on one side of the plane x = 0 the image of the other side's.
    Mirror,
}

impl Tool {
    /// All tools with their names and what they do.
    pub const ALL: [(Self, &'static str, &'static str); 17] = [
        (Self::Look, "Look", "Drag to turn the camera"),
        (Self::Head, "Head", "Drag to move the head, with shift to turn it"),
        (Self::Push(ShapeKind::Sphere), "Ball", "Drag a ball through the hair"),
        (Self::Push(ShapeKind::Hand), "Hand", "Drag a hand through the hair"),
        (Self::Push(ShapeKind::Comb), "Rake", "Drag a solid comb through the hair"),
        (Self::Brush(Brush::Cut), "Cut", "Drag across hair to cut it there"),
        (Self::Brush(Brush::Comb), "Comb", "Drag along hair to turn it that way"),
        (Self::Brush(Brush::Lengthen), "Lengthen", "Drag over roots to make hair longer"),
        (Self::Brush(Brush::Attract), "Attract", "Click to gather hair"),
        (Self::Brush(Brush::Repel), "Repel", "Click to part hair"),
        (Self::Brush(Brush::Curl), "Curl", "Click to curl hair that is rooted there"),
        (Self::Brush(Brush::Straighten), "Straighten", "Click to remove curl"),
        (Self::Brush(Brush::Clump), "Clump", "Click to gather hair into locks"),
        (Self::Brush(Brush::Thicken), "Thicken", "Click to add strands"),
        (Self::Brush(Brush::Thin), "Thin", "Click to remove strands"),
        (Self::Brush(Brush::Smooth), "Smooth", "Click to smooth hair"),
        (
            Self::Brush(Brush::Mirror),
            "Mirror",
            "Click on hair left or right of x = 0 to make the other side its image",
        ),
    ];

    /// Its name on its button.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(tool, ..)| *tool == self).map_or("", |(_, name, _)| name)
    }
}

/// A particle under the pointer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Picked {
    /// Its index.
    pub particle: usize,
    /// Where it is, metres, world space.
    pub position: Vec3,
    /// Its depth along the view, metres.
    pub depth: f32,
}

/// The particle nearest to the eye of those within `reach` pixels of `pixel`.
pub fn pick(moment: &Moment, camera: &Camera, size: [u32; 2], pixel: Vec2, reach: f32) -> Option<Picked> {
    let mut nearest: Option<Picked> = None;
    for (particle, &position) in moment.positions.iter().enumerate() {
        let Some(seen) = camera.project(position, size[0], size[1]) else { continue };
        let is_near = seen.truncate().distance_squared(pixel) <= reach * reach;
        if is_near && nearest.is_none_or(|nearest| seen.z < nearest.depth) {
            nearest = Some(Picked { particle, position, depth: seen.z });
        }
    }
    nearest
}

/// Size and strength of a brush.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BrushSize {
    /// Metres around the pointer.
    pub radius: f32,
    /// From 0, which does nothing, to 1.
    pub strength: f32,
}

impl Default for BrushSize {
    fn default() -> Self {
        Self { radius: 0.03, strength: 0.5 }
    }
}

impl Brush {
    /// Whether its radius counts.
    pub fn has_radius(self) -> bool {
        self != Self::Mirror
    }

    /// Whether the path of the stroke counts; else only where it ends.
    pub fn follows_path(self) -> bool {
        matches!(self, Self::Cut | Self::Comb)
    }

    /// The edit of a stroke through the particles `picked` of `moment`, in order; none for a stroke
    /// that has no effect.
    pub fn edit(self, size: BrushSize, moment: &Moment, picked: &[usize]) -> Option<Edit> {
        let BrushSize { radius, strength } = size;
        let rest = moment.groom().positions();
        let mut points: Vec<Vec3> = picked.iter().filter_map(|&i| rest.get(i).copied()).collect();
        points.dedup_by(|a, b| a.distance(*b) < 1e-4);
        let last = *points.last()?;
        let root = root_of(moment, *picked.last()?)?;
        let operation = match self {
            Self::Cut => {
                // A click cuts too.
                if points.len() < 2 {
                    points.push(last + Vec3::X * 1e-3);
                }
                // Strands are cut where they meet the blade, not a radius before it.
                Operation::Cut(Cut::new(CutShape::Stroke(Stroke { points, radius: 0.3 * radius })))
            }
            Self::Comb if points.len() < 2 => return None,
            Self::Comb => Operation::Comb(Comb { radius, strength, ..Comb::along(points) }),
            Self::Attract => Operation::Attract(Pull { radius, strength, ..Pull::about(last) }),
            Self::Repel => Operation::Repel(Pull { radius, strength, ..Pull::about(last) }),
            Self::Lengthen => Operation::Lengthen(Lengthen { by: 0.1 * strength, ..Lengthen::default() }),
            Self::Curl => Operation::Curl(Curl { amount: strength, ..Curl::default() }),
            Self::Straighten => {
                Operation::Straighten(Straighten { amount: strength, ..Straighten::default() })
            }
            Self::Clump => Operation::Clump(Clump { tip: strength, ..Clump::default() }),
            Self::Thicken => Operation::Density(Density { factor: 1.0 + strength, ..Density::default() }),
            Self::Thin => Operation::Density(Density { factor: 1.0 - strength, ..Density::default() }),
            Self::Smooth => Operation::Smooth(Smooth { amount: strength, ..Smooth::default() }),
            Self::Mirror => {
                let side = 1.0_f32.copysign(root.x);
                // A copy of a groom beside the plane would be off the head.
                let is_on_both = moment.groom().strands().any(|strand| strand[0].x * side < 0.0);
                let normal = Vec3::new(side, 0.0, 0.0);
                is_on_both.then(|| Operation::Mirror(Mirror { normal, ..Mirror::default() }))?
            }
        };
        let by_roots = !matches!(self, Self::Cut | Self::Comb | Self::Attract | Self::Repel | Self::Mirror);
        let only = if by_roots {
            Selection { sphere: Some(Ball { centre: root, radius }), ..Selection::default() }
        } else {
            Selection::default()
        };
        Some(Edit { operation, only })
    }
}

/// The root at rest of the strand that has `particle`.
fn root_of(moment: &Moment, particle: usize) -> Option<Vec3> {
    let groom = moment.groom();
    let after = groom.strand_offsets().partition_point(|&first| first as usize <= particle);
    groom.strands().nth(after.checked_sub(1)?)?.first().copied()
}
