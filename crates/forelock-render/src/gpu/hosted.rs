//! A scene as arrays for the device.

use bytemuck::{Pod, Zeroable};

use glam::Vec3;

use super::GpuRenderError;
use crate::camera::View;
use crate::hair::{Group, PIECE_PX, drawable, strand_count};
use crate::lighting::{OCCLUSION_STRANDS, Plan, chosen_of};
use crate::scene::{Scene, Settings};
use crate::solids::Solids;
use crate::tiles::TileGrid;
use crate::volume::{Layout, open_directions};

/// The side of a tile of the device, pixels.
pub(super) const TILE: u32 = 16;
/// The index that stands for none.
pub(super) const NONE: u32 = u32::MAX;
/// The largest number of points of an edge at which light is computed.
const MAX_LIT: u32 = 12;
/// Threads that draw the triangles of bodies into the shadow maps, about: few triangles may be
/// large ones.
const SLICED: u32 = 65_536;
/// Strands of a group whose edges are measured.
const SAMPLED_STRANDS: usize = 500;

/// The struct of the same name in `frame.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(super) struct FrameData {
    eye: [f32; 3],
    focal: f32,
    right: [f32; 3],
    near: f32,
    up: [f32; 3],
    exposure: f32,
    forward: [f32; 3],
    pub points: u32,
    sky: [f32; 3],
    lights: u32,
    ground: [f32; 3],
    pub capacity: u32,
    shadow_origin: [f32; 3],
    shadow_cell: f32,
    shadow_size: [u32; 3],
    particle_stride: u32,
    open_origin: [f32; 3],
    open_cell: f32,
    open_size: [u32; 3],
    open_start: u32,
    position_origin: [f32; 3],
    component_stride: u32,
    backdrop_top: [f32; 3],
    vignette: f32,
    backdrop_bottom: [f32; 3],
    pub lit_each: u32,
    centre: [f32; 2],
    pub size: [u32; 2],
    pub tiles: [u32; 2],
    pub faces: u32,
    pub samples: u32,
    pub sweeps: u32,
    pub slices: u32,
    unused: [u32; 2],
}

impl FrameData {
    /// Cells of the grid for ambient light.
    pub fn open_cells(&self) -> u32 {
        self.open_size.iter().product()
    }
}

/// The struct of the same name in `frame.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct CurveData {
    base: u32,
    first: u32,
    count: u32,
    start: u32,
    offset: [f32; 3],
    wave: f32,
    log_albedo: [f32; 3],
    tilt: f32,
    bright: f32,
    grey: f32,
    has_colours: u32,
    /// The factor on its width.
    detail: f32,
}

/// `Light` in `light.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct LightData {
    direction: [f32; 3],
    texel: f32,
    colour: [f32; 3],
    heights: u32,
    right: [f32; 3],
    grid: u32,
    up: [f32; 3],
    side: u32,
    origin: [f32; 3],
    unused: u32,
}

/// Everything that the device needs to draw a scene.
pub(super) struct Hosted {
    pub frame: FrameData,
    pub hair: HairArrays,
    pub light: LightArrays,
    pub bodies: BodyArrays,
}

/// Strands and their attributes.
#[derive(Default)]
pub(super) struct HairArrays {
    /// `[3 P]`, particle by particle.
    pub positions: Vec<f32>,
    pub curves: Vec<CurveData>,
    /// The curve of each drawn particle.
    pub owners: Vec<u32>,
    /// Diameters as drawn, `[P]`, metres.
    pub widths: Vec<f32>,
    /// `[P]`, or empty if no group has colours of its own.
    pub albedos: Vec<[f32; 4]>,
}

/// `Sample` in `deposit_hair.wgsl`: a strand of which a grid of optical depths is made.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct SampleData {
    base: u32,
    first: u32,
    count: u32,
    grid: u32,
    weight: f32,
    width: f32,
}

/// `Sweep` in `sweep.wgsl`: a direction in which a grid is swept.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct SweepData {
    direction: [f32; 3],
    cells: u32,
    size: [u32; 3],
    depths: u32,
}

/// Lights, and of what their shadows are made.
#[derive(Default)]
pub(super) struct LightArrays {
    pub lights: Vec<LightData>,
    pub samples: Vec<SampleData>,
    pub sweeps: Vec<SweepData>,
    /// Numbers in the buffers for shadow maps, grids of optical depths, and what is deposited.
    pub room: [usize; 3],
}

/// Bodies.
pub(super) struct BodyArrays {
    pub triangles: Vec<TriangleData>,
    /// The triangles that touch each tile.
    pub bins: Vec<u32>,
    pub vertices: Vec<[[f32; 4]; 4]>,
    /// The vertices of all triangles.
    pub faces: Vec<[u32; 3]>,
}

/// `Triangle` in `bodies.wgsl`: pixel x, pixel y and inverse depth of each corner, and its vertex.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct TriangleData {
    a: [f32; 3],
    va: u32,
    b: [f32; 3],
    vb: u32,
    c: [f32; 3],
    vc: u32,
}

impl Hosted {
    pub fn new(scene: &Scene<'_>, settings: &Settings) -> Result<Self, GpuRenderError> {
        scene.check(settings)?;
        let Settings { width, height, .. } = *settings;
        let view = View::new(&scene.camera, width, height);
        let grid = TileGrid::of_side(TILE, width, height);
        let solids = Solids::new(&scene.bodies, &view, grid)?;
        let groups = Group::all(scene, settings, &view);
        let hair = HairArrays::new(&groups, settings.seed);
        let mut frame = FrameData {
            eye: view.eye.into(),
            focal: view.focal,
            right: view.right.into(),
            near: view.near,
            up: view.up.into(),
            exposure: settings.exposure,
            forward: view.forward.into(),
            points: hair.owners.len() as u32,
            faces: solids.triangles.len() as u32,
            slices: (SLICED / solids.triangles.len().max(1) as u32).clamp(4, 64),
            sky: scene.ambient.sky.into(),
            ground: scene.ambient.ground.into(),
            particle_stride: 3,
            component_stride: 1,
            backdrop_top: scene.backdrop.top.into(),
            vignette: scene.backdrop.vignette,
            backdrop_bottom: scene.backdrop.bottom.into(),
            centre: view.centre,
            size: [width, height],
            tiles: [grid.columns, grid.rows],
            lit_each: lit_each(&groups, &view, [width, height]),
            ..FrameData::default()
        };
        let light =
            LightArrays::new(&Plan::new(scene, &solids, &groups, [width, height]), &groups, &mut frame);
        let bodies = BodyArrays::new(&solids);
        Ok(Self { frame, hair, light, bodies })
    }
}

/// Points of an edge at which light is computed: as many as a long edge in the picture has pieces.
fn lit_each(groups: &[Group<'_>], view: &View, size: [u32; 2]) -> u32 {
    let mut lengths = Vec::new();
    for group in groups {
        let count = strand_count(&group.strands);
        let step = count.div_ceil(SAMPLED_STRANDS).max(1);
        for strand in (0..count).step_by(step) {
            for (_, particles) in drawable(&group.strands, strand..strand + 1) {
                let points = &group.strands.positions[particles];
                lengths.extend(points.windows(2).filter_map(|edge| {
                    let middle = view.to_camera(edge[0].midpoint(edge[1]));
                    let pixel = view.to_pixels(middle);
                    let seen = middle.z > view.near
                        && (0.0..size[0] as f32).contains(&pixel.x)
                        && (0.0..size[1] as f32).contains(&pixel.y);
                    seen.then(|| edge[0].distance(edge[1]) * view.focal * pixel.z)
                }));
            }
        }
    }
    lengths.sort_unstable_by(f32::total_cmp);
    let long = lengths.get(lengths.len() * 9 / 10).copied().unwrap_or(0.0);
    ((long / PIECE_PX).ceil() as u32).clamp(1, MAX_LIT)
}

impl HairArrays {
    fn new(groups: &[Group<'_>], seed: u32) -> Self {
        let mut arrays = Self::default();
        let has_colours = groups.iter().any(|group| group.strands.colours.is_some());
        for group in groups {
            let before = arrays.widths.len() as u32;
            arrays.append_particles(group, has_colours);
            for (strand, particles) in drawable(&group.strands, 0..strand_count(&group.strands)) {
                let (first, count) = (before + particles.start as u32, particles.len() as u32);
                let places = arrays.widths[first as usize..][..count as usize].iter_mut();
                for (i, width) in places.enumerate() {
                    *width = group.width(particles.start, i as f32, i as f32 / (count - 1) as f32);
                }
                for child in 0..group.children {
                    let detail = group.detail(strand as u32, child);
                    if detail == 0.0 {
                        continue;
                    }
                    let start = arrays.owners.len();
                    arrays.owners.resize(start + count as usize, arrays.curves.len() as u32);
                    let draws = group.draws(seed, strand as u32, child);
                    arrays.curves.push(CurveData {
                        base: 3 * first,
                        first,
                        count,
                        start: start as u32,
                        offset: draws.offset.into(),
                        wave: draws.wave,
                        log_albedo: draws.log_albedo.into(),
                        tilt: draws.tilt,
                        bright: draws.bright,
                        grey: draws.grey,
                        has_colours: group.strands.colours.is_some().into(),
                        detail,
                    });
                }
            }
        }
        arrays
    }

    /// Appends the positions and albedos of all particles of `group`, and room for their widths.
    fn append_particles(&mut self, group: &Group<'_>, has_colours: bool) {
        self.positions.extend_from_slice(bytemuck::cast_slice(group.strands.positions));
        let count = self.positions.len() / 3;
        self.widths.resize(count, 0.0);
        if has_colours {
            let colours = group.strands.colours.unwrap_or_default();
            self.albedos.extend(colours.iter().map(|&[r, g, b]| [r, g, b, 0.0]));
            self.albedos.resize(count, [0.0; 4]);
        }
    }
}

impl LightArrays {
    /// The arrays of `plan`; its layout goes to `frame`.
    fn new(plan: &Plan, groups: &[Group<'_>], frame: &mut FrameData) -> Self {
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
            let weight = weight * group.children as f32;
            let width = group.strands.widths.map_or_else(|| group.width(0, 0.0, 0.0), |_| 0.0);
            for strand in (0..chosen).map(|k| k * every) {
                for (_, particles) in drawable(&group.strands, strand..strand + 1) {
                    let (first, count) = (before + particles.start as u32, particles.len() as u32);
                    self.samples.push(SampleData { base: 3 * first, first, count, grid, weight, width });
                }
            }
            before += group.strands.positions.len() as u32;
        }
    }
}

impl BodyArrays {
    fn new(solids: &Solids<'_>) -> Self {
        let triangles = solids.screen.iter().map(|triangle| {
            let [a, b, c] = triangle.corners.map(Into::into);
            let [va, vb, vc] = solids.triangles[triangle.source as usize];
            TriangleData { a, va, b, vb, c, vc }
        });
        let faces = solids.triangles.clone();
        Self { triangles: triangles.collect(), bins: solids.bins.flat(), vertices: solids.vertices(), faces }
    }
}

#[cfg(test)]
mod tests {
    use super::super::stages::STAGES;
    use super::*;
    use std::mem::{offset_of, size_of};

    /// What the modules of all stages say.
    fn modules() -> Vec<(&'static str, naga::Module)> {
        let parse = |text: String| naga::front::wgsl::parse_str(&text).unwrap();
        STAGES.iter().map(|stage| (stage.name, parse(stage.source()))).collect()
    }

    /// Checks that `name` has the fields of a struct of `size` bytes wherever a module has it.
    fn has_layout(name: &str, size: usize, fields: &[(&str, usize)]) {
        let mut found = 0;
        for (stage, module) in modules() {
            for (_, own) in module.types.iter().filter(|(_, own)| own.name.as_deref() == Some(name)) {
                let naga::TypeInner::Struct { members, span } = &own.inner else { continue };
                let offsets: Vec<_> =
                    members.iter().map(|m| (m.name.as_deref().unwrap_or(""), m.offset as usize)).collect();
                assert_eq!(offsets, fields, "{name} in {stage}");
                assert_eq!(*span as usize, size, "{name} in {stage}");
                found += 1;
            }
        }
        assert!(found > 0, "{name}");
    }

    macro_rules! offsets {
        ($own:ty: $($field:ident)*) => { [$((stringify!($field), offset_of!($own, $field))),*] };
    }

    #[test]
    fn structs_are_those_of_the_kernels() {
        let frame = offsets!(FrameData: eye focal right near up exposure forward points sky lights ground
            capacity shadow_origin shadow_cell shadow_size particle_stride open_origin open_cell open_size
            open_start position_origin component_stride
            backdrop_top vignette backdrop_bottom lit_each centre size tiles faces samples sweeps slices);
        has_layout("Frame", size_of::<FrameData>(), &frame);
        let curve = offsets!(CurveData: base first count start offset wave log_albedo tilt bright grey
            has_colours detail);
        has_layout("Curve", size_of::<CurveData>(), &curve);
        let light = offsets!(LightData: direction texel colour heights right grid up side origin
            unused);
        has_layout("Light", size_of::<LightData>(), &light);
        let triangle = offsets!(TriangleData: a va b vb c vc);
        has_layout("Triangle", size_of::<TriangleData>(), &triangle);
        let sample = offsets!(SampleData: base first count grid weight width);
        has_layout("Sample", size_of::<SampleData>(), &sample);
        let sweep = offsets!(SweepData: direction cells size depths);
        has_layout("Sweep", size_of::<SweepData>(), &sweep);
    }

    #[test]
    fn kernels_keep_to_the_limits_of_webgpu() {
        for (name, module) in modules() {
            let flags = naga::valid::ValidationFlags::all();
            // `pack2x16float` is part of WebGPU.
            let core = naga::valid::Capabilities::SHADER_FLOAT16_IN_FLOAT32;
            let mut validator = naga::valid::Validator::new(flags, core);
            validator.validate(&module).unwrap_or_else(|error| panic!("{name}: {error:?}"));
            let layouts = {
                let mut layouter = naga::proc::Layouter::default();
                layouter.update(module.to_ctx()).unwrap();
                layouter
            };
            let shared =
                module.global_variables.iter().filter(|(_, own)| own.space == naga::AddressSpace::WorkGroup);
            let bytes: u32 = shared.map(|(_, own)| layouts[own.ty].size).sum();
            assert!(bytes <= 16_384, "{name}: {bytes} bytes");
        }
        assert!(STAGES.iter().all(|stage| stage.storage_buffers() <= 8));
    }
}
