//! Lines in colours of their own, drawn into the picture of the hair.

use forelock_render::{HairColour, Strands};
use glam::Vec3;

/// Polylines in world space.
#[derive(Debug)]
pub struct Lines {
    /// Metres.
    pub positions: Vec<Vec3>,
    /// The first position of each line, and one number more.
    pub offsets: Vec<u32>,
    /// Linear RGB of each position.
    pub colours: Vec<[f32; 3]>,
}

impl Default for Lines {
    fn default() -> Self {
        Self { positions: Vec::new(), offsets: vec![0], colours: Vec::new() }
    }
}

impl Lines {
    /// Adds a line through `points`.
    pub fn add(&mut self, points: impl IntoIterator<Item = Vec3>, colour: [f32; 3]) {
        self.positions.extend(points);
        self.offsets.push(self.positions.len() as u32);
        self.colours.resize(self.positions.len(), colour);
    }

    /// Its lines for a picture.
    pub fn strands(&self) -> Strands<'_> {
        let strands = Strands::new(&self.positions, &self.offsets, HairColour::BLACK);
        Strands { colours: Some(&self.colours), ..strands }
    }
}
