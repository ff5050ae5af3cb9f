//! Lights, and of what their shadows are made, as arrays for the device.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use super::hosted::{FrameData, NONE};
use crate::hair::Group;
use crate::lighting::{OCCLUSION_STRANDS, Plan, chosen_of};
use crate::volume::{Layout, open_directions};

/// `Light` in `light.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct LightData {
    pub direction: [f32; 3],
    pub texel: f32,
    pub colour: [f32; 3],
    pub heights: u32,
    pub right: [f32; 3],
    pub grid: u32,
    pub up: [f32; 3],
    pub side: u32,
    pub origin: [f32; 3],
    pub unused: u32,
}

/// `Sample` in `deposit_hair.wgsl`: a strand of which a grid of optical depths is made.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct SampleData {
    pub base: u32,
    pub first: u32,
    pub count: u32,
    pub grid: u32,
    pub weight: f32,
    pub width: f32,
}

/// `Sweep` in `sweep.wgsl`: a direction in which a grid is swept.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct SweepData {
    pub direction: [f32; 3],
    pub cells: u32,
    pub size: [u32; 3],
    pub depths: u32,
}

/// Lights, and of what their shadows are made.
#[derive(Debug, Default)]
pub(super) struct LightArrays {
    pub lights: Vec<LightData>,
    pub samples: Vec<SampleData>,
    pub sweeps: Vec<SweepData>,
    /// Numbers in the buffers for shadow maps, grids of optical depths, and what is deposited.
    pub room: [usize; 3],
}

impl LightArrays {
    /// The arrays of `plan`; its layout goes to `frame`.
    pub fn new(plan: &Plan, groups: &[Group<'_>], frame: &mut FrameData) -> Self {
        let mut arrays = Self::default();
        let [mut heights, mut grids, mut deposits] = [0; 3];
        if let Some(layout) = plan.shadows {
            let Layout { origin, cell, size } = layout;
            (frame.shadow_origin, frame.shadow_cell, frame.shadow_size) = (origin.into(), cell, size.into());
            deposits += layout.len();
            arrays.sample(groups, plan.shadow_strands, 0);
        }
        for (light, map) in &plan.lights {
            let mut data = LightData {
                direction: light.direction.into(),
                colour: light.colour.into(),
                heights: NONE,
                grid: NONE,
                ..LightData::zeroed()
            };
            if let Some(map) = map {
                let [right, up, _] = map.axes;
                (data.right, data.up, data.origin) = (right.into(), up.into(), map.origin.into());
                (data.texel, data.side, data.heights) = (map.texel(), map.side as u32, heights as u32);
                heights += map.side * map.side;
            }
            if let Some(layout) = plan.shadows.filter(|_| light.shadows) {
                data.grid = grids as u32;
                arrays.sweep(-light.direction, 0, layout, &mut grids);
            }
            arrays.lights.push(data);
        }
        if let Some(layout) = plan.openness {
            let Layout { origin, cell, size } = layout;
            (frame.open_origin, frame.open_cell, frame.open_size) = (origin.into(), cell, size.into());
            frame.open_start = grids as u32;
            grids += layout.len();
            for direction in open_directions() {
                arrays.sweep(direction, deposits, layout, &mut grids);
            }
            deposits += layout.len();
            arrays.sample(groups, OCCLUSION_STRANDS, 1);
        }
        frame.lights = arrays.lights.len() as u32;
        (frame.samples, frame.sweeps) = (arrays.samples.len() as u32, arrays.sweeps.len() as u32);
        arrays.room = [heights, grids, deposits];
        arrays
    }

    fn sweep(&mut self, direction: Vec3, cells: usize, layout: Layout, grids: &mut usize) {
        let (direction, size) = (direction.into(), layout.size.into());
        self.sweeps.push(SweepData { direction, cells: cells as u32, size, depths: *grids as u32 });
        *grids += layout.len();
    }

    /// Chooses about `most` strands of each group for grid number `grid`.
    fn sample(&mut self, groups: &[Group<'_>], most: usize, grid: u32) {
        let mut before = 0;
        for group in groups {
            let (every, chosen, weight) = chosen_of(group, most);
            let weight = weight * group.children as f32 * group.width_scale;
            let width = group.strands.widths.map_or_else(|| group.bare_width(0, 0.0, 0.0), |_| 0.0);
            for strand in (0..chosen).map(|k| k * every) {
                for (_, particles) in group.drawable(strand..strand + 1) {
                    let (first, count) = (before + particles.start as u32, particles.len() as u32);
                    self.samples.push(SampleData { base: 3 * first, first, count, grid, weight, width });
                }
            }
            before += group.strands.positions.len() as u32;
        }
    }
}
