//! A scene as arrays for the device.

use bytemuck::{Pod, Zeroable};

use super::GpuRenderError;
use super::curves::{self, HairArrays};
use super::meshes::{self, BodyArrays};
use super::shadows::LightArrays;
use super::shared::SharedPositions;
use crate::camera::View;
use crate::drawable::strand_count;
use crate::hair::{Group, PIECE_PX};
use crate::lighting::Plan;
use crate::scene::{Scene, Settings};

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
    pub lights: u32,
    ground: [f32; 3],
    pub capacity: u32,
    pub shadow_origin: [f32; 3],
    pub shadow_cell: f32,
    pub shadow_size: [u32; 3],
    unused: u32,
    pub open_origin: [f32; 3],
    pub open_cell: f32,
    pub open_size: [u32; 3],
    pub open_start: u32,
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
    pub vertices: u32,
    pub target_near: f32,
}

impl FrameData {
    /// Cells of the grid for ambient light.
    pub fn open_cells(&self) -> u32 {
        self.open_size.iter().product()
    }
}

/// Everything that the device needs to draw a scene, kept from one frame to the next.
#[derive(Debug, Default)]
pub(super) struct Hosted {
    pub frame: FrameData,
    pub hair: HairArrays,
    pub light: LightArrays,
    pub bodies: BodyArrays,
}

/// What is new since the frame before.
#[derive(Clone, Copy, Debug)]
pub(super) struct News {
    pub hair: curves::News,
    pub bodies: meshes::News,
}

impl Hosted {
    /// Makes everything that of `scene`, but for the positions of strands. Those of the groups in
    /// `shared` may be outside the box of the scene's.
    pub fn update(
        &mut self,
        scene: &Scene<'_>,
        settings: &Settings,
        shared: &[(usize, SharedPositions)],
    ) -> Result<News, GpuRenderError> {
        scene.check(settings)?;
        let Settings { width, height, .. } = *settings;
        let view = View::new(&scene.camera, width, height);
        let mut groups = Group::all(scene, settings, &view);
        for (group, own) in shared {
            if let Some(Group { bounds: (lo, hi), .. }) = groups.get_mut(*group) {
                (*lo, *hi) = (*lo - own.margin, *hi + own.margin);
            }
        }
        let news = News {
            hair: self.hair.update(&groups, settings.seed),
            bodies: self.bodies.update(&scene.bodies)?,
        };
        let faces = self.bodies.faces.len() as u32;
        self.frame = FrameData {
            eye: view.eye.into(),
            focal: view.focal,
            right: view.right.into(),
            near: view.near,
            up: view.up.into(),
            exposure: settings.exposure,
            forward: view.forward.into(),
            points: self.hair.owners.len() as u32,
            vertices: self.bodies.vertices.len() as u32,
            faces,
            slices: (SLICED / faces.max(1)).clamp(4, 64),
            sky: scene.ambient.sky.into(),
            ground: scene.ambient.ground.into(),
            backdrop_top: scene.backdrop.top.into(),
            vignette: scene.backdrop.vignette,
            backdrop_bottom: scene.backdrop.bottom.into(),
            centre: view.centre,
            size: [width, height],
            tiles: [width.div_ceil(TILE), height.div_ceil(TILE)],
            lit_each: lit_each(&groups, &view, [width, height]),
            ..FrameData::default()
        };
        let plan = Plan::new(scene, self.bodies.bounds(), &groups, [width, height]);
        self.light = LightArrays::new(&plan, &groups, &mut self.frame);
        Ok(news)
    }
}

/// Points of an edge at which light is computed: as many as a long edge in the picture has pieces.
fn lit_each(groups: &[Group<'_>], view: &View, size: [u32; 2]) -> u32 {
    let mut lengths = Vec::new();
    for group in groups {
        let count = strand_count(&group.strands);
        let step = count.div_ceil(SAMPLED_STRANDS).max(1);
        for strand in (0..count).step_by(step) {
            for (_, particles) in group.drawable(strand..strand + 1) {
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

#[cfg(test)]
mod tests {
    use super::super::curves::CurveData;
    use super::super::meshes::{MeshVertexData, PlacementData, VertexData};
    use super::super::present;
    use super::super::shadows::{LightData, SampleData, SweepData};
    use super::super::shared::{self, GatherData};
    use super::super::stages::{STAGES, source};
    use super::*;
    use std::mem::{offset_of, size_of};

    /// What the modules of all stages say.
    fn modules() -> Vec<(&'static str, naga::Module)> {
        let parse = |text: String| naga::front::wgsl::parse_str(&text).unwrap();
        let others = [("gather", shared::TEXTS), ("present", present::PRESENT), ("hide", present::HIDE)];
        let stages = STAGES.iter().map(|stage| (stage.name, stage.source()));
        let texts = stages.chain(others.map(|(name, texts)| (name, source(texts))));
        texts.map(|(name, text)| (name, parse(text))).collect()
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
            capacity shadow_origin shadow_cell shadow_size unused open_origin open_cell open_size
            open_start backdrop_top vignette backdrop_bottom lit_each centre size tiles faces samples sweeps slices vertices target_near);
        has_layout("Frame", size_of::<FrameData>(), &frame);
        let curve = offsets!(CurveData: base first count start offset wave log_albedo tilt bright grey
            has_colours detail);
        has_layout("Curve", size_of::<CurveData>(), &curve);
        let light = offsets!(LightData: direction texel colour heights right grid up side origin
            unused);
        has_layout("Light", size_of::<LightData>(), &light);
        let vertex = offsets!(MeshVertexData: position share normal body rest unused);
        has_layout("MeshVertex", size_of::<MeshVertexData>(), &vertex);
        let placed = offsets!(VertexData: position has_face normal brow_red skin brow_green rest brow_blue);
        has_layout("Vertex", size_of::<VertexData>(), &placed);
        let placement = offsets!(PlacementData: x_axis has_face y_axis unused_y z_axis unused_z origin
            unused_origin skin unused_skin scalp unused_scalp brows unused_brows);
        has_layout("Placement", size_of::<PlacementData>(), &placement);
        let sample = offsets!(SampleData: base first count grid weight width);
        has_layout("Sample", size_of::<SampleData>(), &sample);
        let sweep = offsets!(SweepData: direction cells size depths);
        let gather = offsets!(GatherData: origin stride first count unused);
        has_layout("Gather", size_of::<GatherData>(), &gather);
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
