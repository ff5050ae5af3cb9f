//! The line of a strand while it grows, and the particles that are placed on it at the end.

use glam::Vec3;

/// A strand as a line of many points, about `spacing` apart.
#[derive(Clone, Debug, Default)]
pub(super) struct Curve {
    /// The points, the root first, in metres.
    pub(super) points: Vec<Vec3>,
    /// How much lower each point would hang if the strand did not lie on a shoulder, in metres.
    pub(super) sags: Vec<f32>,
    /// A lower bound of each point's distance from the body, in metres.
    pub(super) gaps: Vec<f32>,
    /// Length of strand between two points, in metres.
    pub(super) spacing: f32,
}

impl Curve {
    /// Starts again at `root`.
    pub(super) fn start(&mut self, root: Vec3, spacing: f32) {
        self.points.clear();
        self.sags.clear();
        self.gaps.clear();
        self.push(root, 0.0, 0.0);
        self.spacing = spacing;
    }

    pub(super) fn push(&mut self, point: Vec3, sag: f32, gap: f32) {
        self.points.push(point);
        self.gaps.push(gap);
        self.sags.push(sag);
    }

    /// The point at the length `arc` from the root, in metres; the last point beyond the end.
    pub(super) fn at(&self, arc: f32) -> Vec3 {
        let last = self.points.len() - 1;
        let place = (arc / self.spacing).clamp(0.0, last as f32);
        let before = (place as usize).min(last);
        self.points[before].lerp(self.points[(before + 1).min(last)], place - before as f32)
    }

    /// Places particles on the line from the root to the fraction `end` of it, at equal distances
    /// from each other.
    pub(super) fn place(&self, end: f32, out: &mut [Vec3]) {
        let places = (self.points.len() - 1) as f32;
        let until = end.clamp(0.0, 1.0) * places;
        let edges = (out.len() - 1) as f32;
        // Chords are shorter than the line, by how much is found by walking along it.
        let mut edge = until * self.spacing / edges;
        for _ in 0..8 {
            let reached = self.walk(edge, out);
            let ratio = until / reached.max(f32::MIN_POSITIVE);
            if (ratio - 1.0).abs() < 5e-3 {
                break;
            }
            edge *= ratio.clamp(0.5, 2.0);
        }
    }

    /// Places particles at the distance `edge` from each other and returns where the last one is,
    /// in points from the root. The line continues straight beyond its end.
    fn walk(&self, edge: f32, out: &mut [Vec3]) -> f32 {
        let last = self.points.len() - 1;
        out[0] = self.points[0];
        // The line up to `segment` has been passed.
        let (mut segment, mut place) = (0, 0.0);
        for i in 1..out.len() {
            let from = out[i - 1];
            while segment + 1 < last && self.points[segment + 1].distance(from) < edge {
                segment += 1;
            }
            let (a, b) = (self.points[segment], self.points[segment + 1]);
            let (along, back) = (b - a, a - from);
            // |back + t along| = edge, the larger solution.
            let (square, half) = (along.length_squared().max(f32::MIN_POSITIVE), along.dot(back));
            let root = (half * half - square * (back.length_squared() - edge * edge)).max(0.0).sqrt();
            let t = (root - half) / square;
            out[i] = from + (back + along * t).normalize_or(Vec3::NEG_Y) * edge;
            place = segment as f32 + t;
        }
        place
    }
}
