//! The kernels and the buffers that they read and write.

use std::fmt::Write;

use super::GpuRenderError;
use super::hosted::{FrameData, NONE, TILE};
use crate::colour::ALBEDO_FROM_ABSORPTION;
use crate::fibre::{FRESNEL_0, HAIR_DENSITY, PATHS, REFLECTED, ROUGHNESS, SCALE_TILT};
use crate::hair::{FILTER_RADIUS, MAX_PIECES, PIECE_PX};
use crate::lighting::{EXTINCTION, SURFACE_DEPTH, WRAP};
use crate::raster::OPAQUE;
use crate::volume::OPEN_DIRECTIONS;

/// Threads of a workgroup; in a tile, one a pixel.
const THREADS: u32 = TILE * TILE;
/// Numbers of pieces that an edge has room for.
pub(super) const PIECES_EACH: u32 = 32;
/// The integer for an optical depth of 1.
const DEPOSIT_UNIT: f32 = 1_048_576.0;
/// The largest optical depth of a deposit. No light passes a tenth of it.
const MOST_DEPTH: f32 = 256.0;
/// The number from which on a cell takes no more deposits: half of the range, so that the deposits
/// of 8 threads at once do not leave it.
const FULL_CELL: u32 = 1 << 31;
/// What the sizes of buffers are multiples of, bytes.
const UNIT: u64 = 16;
/// The formats of the numbers and depths of the nearest triangles.
pub(super) const IDS: wgpu::TextureFormat = wgpu::TextureFormat::R32Uint;
pub(super) const DEPTHS: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
/// The largest number of workgroups of a dispatch along an axis that is used.
const MAX_GROUPS: u32 = 32_768;

pub(super) const FRAME: &str = include_str!("wgsl/frame.wgsl");
const PARTICLES: &str = include_str!("wgsl/particles.wgsl");
const STRAND: &str = include_str!("wgsl/strand.wgsl");
const VERTEX: &str = include_str!("wgsl/vertex.wgsl");
const FACES: &str = include_str!("wgsl/faces.wgsl");
const SAMPLES: &str = include_str!("wgsl/samples.wgsl");
const DEPOSIT: &str = include_str!("wgsl/deposit.wgsl");
const LIGHT: &str = include_str!("wgsl/light.wgsl");
const LIGHTS: &str = include_str!("wgsl/lights.wgsl");
const PIECES: &str = include_str!("wgsl/pieces.wgsl");
pub(super) const FULL_SCREEN: &str = include_str!("wgsl/full_screen.wgsl");
pub(super) const TONE: &str = include_str!("wgsl/tone.wgsl");

/// The number of a binding, the same in all kernels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub(super) enum Slot {
    Frame,
    Positions,
    Curves,
    Owners,
    Widths,
    Albedos,
    Lights,
    Grids,
    Heights,
    Points,
    Radiance,
    Counts,
    Offsets,
    List,
    Horizon,
    Report,
    Behind,
    Ids,
    Picture,
    Meshes,
    Placements,
    Vertices,
    Faces,
    Deposits,
    Samples,
    Sweeps,
    Depths,
}

/// The number of slots.
const SLOTS: usize = Depths as usize + 1;

/// A stage of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Stage {
    pub name: &'static str,
    slots: &'static [Slot],
    threads: Threads,
}

/// What the threads of a stage are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Threads {
    /// None: it is a render pass over the triangles of bodies.
    Rasterizer,
    /// Vertices of bodies.
    Vertices,
    /// Triangles of bodies.
    Faces,
    /// Several for each triangle.
    FaceSlices,
    /// Strands that the grids are made of.
    Samples,
    /// A workgroup for each direction in which a grid is swept.
    Sweeps,
    /// Cells of the grid for ambient light.
    OpenCells,
    Points,
    /// Points on edges at which light is computed.
    Lit,
    /// One workgroup.
    Once,
    /// A workgroup a tile.
    Tiles,
}

use Slot::{
    Albedos, Behind, Counts, Curves, Deposits, Depths, Faces, Frame, Grids, Heights, Horizon, Ids, Lights,
    List, Meshes, Offsets, Owners, Picture, Placements, Points, Positions, Radiance, Report, Samples, Sweeps,
    Vertices, Widths,
};

/// All stages, in the order in which they run.
pub(super) const STAGES: [Stage; 15] = [
    Stage { name: "place", slots: &[Frame, Meshes, Placements, Vertices], threads: Threads::Vertices },
    Stage {
        name: "map_shadows",
        slots: &[Frame, Lights, Heights, Vertices, Faces],
        threads: Threads::FaceSlices,
    },
    Stage {
        name: "deposit_hair",
        slots: &[Frame, Positions, Widths, Deposits, Samples],
        threads: Threads::Samples,
    },
    Stage { name: "deposit_bodies", slots: &[Frame, Vertices, Faces, Deposits], threads: Threads::Faces },
    Stage { name: "sweep", slots: &[Grids, Deposits, Sweeps], threads: Threads::Sweeps },
    Stage { name: "open", slots: &[Frame, Grids], threads: Threads::OpenCells },
    Stage { name: "cover", slots: &[Frame, Vertices, Faces], threads: Threads::Rasterizer },
    Stage {
        name: "bodies",
        slots: &[Frame, Lights, Grids, Heights, Horizon, Behind, Ids, Depths, Vertices, Faces],
        threads: Threads::Tiles,
    },
    Stage {
        name: "project",
        slots: &[Frame, Positions, Curves, Owners, Widths, Points],
        threads: Threads::Points,
    },
    Stage {
        name: "shade",
        slots: &[Frame, Positions, Curves, Owners, Albedos, Lights, Grids, Heights, Radiance],
        threads: Threads::Lit,
    },
    Stage {
        name: "count",
        slots: &[Frame, Curves, Owners, Points, Counts, Horizon],
        threads: Threads::Points,
    },
    Stage { name: "sum_up", slots: &[Frame, Counts, Offsets, Report], threads: Threads::Once },
    Stage {
        name: "fill",
        slots: &[Frame, Curves, Owners, Points, Counts, Offsets, List, Horizon],
        threads: Threads::Points,
    },
    Stage { name: "sort", slots: &[Frame, Offsets, List], threads: Threads::Tiles },
    Stage {
        name: "resolve",
        slots: &[Frame, Curves, Owners, Points, Radiance, Offsets, List, Behind, Depths, Picture],
        threads: Threads::Tiles,
    },
];

impl Stage {
    /// The whole text of its shader.
    #[cfg(test)]
    pub fn source(&self) -> String {
        source(self.texts())
    }

    /// Storage buffers that it binds.
    #[cfg(test)]
    pub fn storage_buffers(&self) -> usize {
        self.slots.iter().filter(|slot| !matches!(slot, Frame | Behind | Ids | Depths)).count()
    }

    /// The texts of its shader.
    fn texts(&self) -> &'static [&'static str] {
        match self.name {
            "place" => &[FRAME, VERTEX, include_str!("wgsl/place.wgsl")],
            "cover" => &[FRAME, VERTEX, FACES, include_str!("wgsl/cover.wgsl")],
            "project" => &[FRAME, PARTICLES, STRAND, include_str!("wgsl/project.wgsl")],
            "map_shadows" => &[FRAME, LIGHT, VERTEX, FACES, include_str!("wgsl/map_shadows.wgsl")],
            "deposit_hair" => &[FRAME, PARTICLES, DEPOSIT, include_str!("wgsl/deposit_hair.wgsl")],
            "deposit_bodies" => &[FRAME, VERTEX, FACES, DEPOSIT, include_str!("wgsl/deposit_bodies.wgsl")],
            "sweep" => &[FRAME, include_str!("wgsl/sweep.wgsl")],
            "open" => &[FRAME, include_str!("wgsl/open.wgsl")],
            "bodies" => &[
                FRAME,
                LIGHT,
                LIGHTS,
                VERTEX,
                FACES,
                SAMPLES,
                include_str!("wgsl/face.wgsl"),
                include_str!("wgsl/bodies.wgsl"),
            ],
            "shade" => &[
                FRAME,
                PARTICLES,
                STRAND,
                LIGHT,
                LIGHTS,
                include_str!("wgsl/fibre.wgsl"),
                include_str!("wgsl/shade.wgsl"),
            ],
            "sort" => &[FRAME, include_str!("wgsl/sort.wgsl")],
            "resolve" => &[FRAME, SAMPLES, PIECES, TONE, include_str!("wgsl/resolve.wgsl")],
            _ => &[FRAME, PIECES, include_str!("wgsl/bins.wgsl")],
        }
    }

    /// The workgroups for a frame.
    pub fn workgroups(&self, frame: &FrameData) -> [u32; 2] {
        let threads = match self.threads {
            Threads::Rasterizer => return [0, 0],
            Threads::Once => 1,
            Threads::Vertices => frame.vertices,
            Threads::Tiles => return frame.tiles,
            Threads::Sweeps => return [frame.sweeps, 1],
            Threads::Faces => frame.faces,
            Threads::FaceSlices => frame.faces * frame.slices,
            Threads::Samples => frame.samples,
            Threads::OpenCells => frame.open_cells(),
            Threads::Points => frame.points,
            Threads::Lit => frame.points * frame.lit_each,
        };
        workgroups_for(threads)
    }
}

/// The workgroups for `threads` threads.
pub(super) fn workgroups_for(threads: u32) -> [u32; 2] {
    let groups = threads.div_ceil(THREADS);
    [groups.min(MAX_GROUPS), groups.div_ceil(MAX_GROUPS)]
}

/// The constants that the shaders take from the CPU renderer.
fn constants() -> String {
    let floats = [
        ("SCALE_TILT", SCALE_TILT),
        ("ROUGHNESS", ROUGHNESS),
        ("FRESNEL_0", FRESNEL_0),
        ("REFLECTED", REFLECTED),
        ("HAIR_DENSITY", HAIR_DENSITY),
        ("TT_PATH", PATHS[0]),
        ("TRT_PATH", PATHS[1]),
        ("ALBEDO_FROM_ABSORPTION", ALBEDO_FROM_ABSORPTION),
        ("EXTINCTION", EXTINCTION),
        ("SURFACE_DEPTH", SURFACE_DEPTH),
        ("DEPOSIT_UNIT", DEPOSIT_UNIT),
        ("MOST_DEPTH", MOST_DEPTH),
        ("WRAP_RED", WRAP.x),
        ("WRAP_GREEN", WRAP.y),
        ("WRAP_BLUE", WRAP.z),
        ("FILTER_RADIUS", FILTER_RADIUS),
        ("PIECE_PX", PIECE_PX),
        ("MAX_PIECES", MAX_PIECES),
        ("OPAQUE", OPAQUE),
    ];
    let numbers = [
        ("THREADS", THREADS),
        ("TILE", TILE),
        ("NONE", NONE),
        ("PIECES_EACH", PIECES_EACH),
        ("OPEN_DIRECTIONS", OPEN_DIRECTIONS as u32),
        ("FULL_CELL", FULL_CELL),
    ];
    let mut text = String::new();
    // Writing to a string cannot fail.
    for (name, value) in floats {
        let _ = writeln!(text, "const {name}: f32 = {value:e}f;");
    }
    for (name, value) in numbers {
        let _ = writeln!(text, "const {name}: u32 = {value}u;");
    }
    text
}

/// The whole text of the shader of `texts`.
pub(super) fn source(texts: &[&str]) -> String {
    [&constants(), texts.concat().as_str()].concat()
}

pub(super) fn module(device: &wgpu::Device, label: &str, texts: &[&str]) -> wgpu::ShaderModule {
    let source = source(texts);
    device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(label),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    })
}

/// A stage on a device.
#[derive(Debug)]
pub(super) enum Pipeline {
    Compute(wgpu::ComputePipeline),
    /// Draws the triangles of bodies into [`Slot::Ids`] and [`Slot::Depths`].
    Render(wgpu::RenderPipeline),
}

impl Pipeline {
    /// The pipeline of `stage`.
    pub fn new(device: &wgpu::Device, stage: &Stage) -> Self {
        let module = &module(device, stage.name, stage.texts());
        if stage.threads == Threads::Rasterizer {
            return Self::Render(rasterizing(device, module, stage.name));
        }
        Self::Compute(device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(stage.name),
            layout: None,
            module,
            entry_point: Some(stage.name),
            compilation_options: Default::default(),
            cache: None,
        }))
    }

    fn layout(&self) -> wgpu::BindGroupLayout {
        match self {
            Self::Compute(own) => own.get_bind_group_layout(0),
            Self::Render(own) => own.get_bind_group_layout(0),
        }
    }
}

/// The pipeline that draws triangles: nearer ones have larger depths, and of equal ones the first
/// is seen.
fn rasterizing(device: &wgpu::Device, module: &wgpu::ShaderModule, name: &str) -> wgpu::RenderPipeline {
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(name),
        layout: None,
        vertex: wgpu::VertexState {
            module,
            entry_point: Some("corner"),
            compilation_options: Default::default(),
            buffers: &[],
        },
        primitive: Default::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTHS,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Greater),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module,
            entry_point: Some(name),
            compilation_options: Default::default(),
            targets: &[Some(IDS.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// The buffers and textures of a renderer. Buffers grow and are kept from one frame to the next.
#[derive(Debug, Default)]
pub(super) struct Memory {
    buffers: [Option<wgpu::Buffer>; SLOTS],
    /// The textures of [`Behind`], [`Ids`] and [`Depths`].
    views: Option<[wgpu::TextureView; 3]>,
}

impl Memory {
    /// Makes room for `bytes` in `slot`. What a buffer holds is lost if it grows.
    pub fn reserve(&mut self, device: &wgpu::Device, slot: Slot, bytes: u64) -> Result<(), GpuRenderError> {
        let usage = match slot {
            Frame => wgpu::BufferUsages::UNIFORM,
            _ => wgpu::BufferUsages::STORAGE,
        };
        let own = &mut self.buffers[slot as usize];
        let limit = most_bound(device);
        // Copies and clears need multiples of four bytes.
        let size = bytes.max(256).next_multiple_of(UNIT);
        if size > limit {
            return Err(GpuRenderError::TooLarge { what: described(slot), bytes, limit });
        }
        if own.as_ref().is_none_or(|buffer| buffer.size() < size) {
            *own = Some(device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(described(slot)),
                size,
                usage: usage | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            }));
        }
        Ok(())
    }

    /// Bytes of all buffers and textures.
    pub fn bytes(&self) -> u64 {
        let bytes = |view: &wgpu::TextureView| {
            let own = view.texture();
            let texels = u64::from(own.width()) * u64::from(own.height());
            texels * u64::from(own.format().block_copy_size(None).unwrap_or(4))
        };
        let textures: u64 = self.views.iter().flatten().map(bytes).sum();
        textures + self.buffers.iter().flatten().map(wgpu::Buffer::size).sum::<u64>()
    }

    /// The buffer of `slot`.
    pub fn buffer(&self, slot: Slot) -> Result<&wgpu::Buffer, GpuRenderError> {
        let own = self.buffers[slot as usize].as_ref();
        own.ok_or_else(|| GpuRenderError::Failed(format!("there is no buffer for the {}", described(slot))))
    }

    /// Makes the textures of a picture of `size` pixels.
    pub fn size_textures(&mut self, device: &wgpu::Device, [width, height]: [u32; 2]) {
        let fits = |[behind, ..]: &[wgpu::TextureView; 3]| {
            [behind.texture().width(), behind.texture().height()] == [width, height]
        };
        if self.views.as_ref().is_some_and(fits) {
            return;
        }
        let make = |label, side: u32, format, usage| {
            let texture = device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width: side * width, height: side * height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::TEXTURE_BINDING | usage,
                view_formats: &[],
            });
            texture.create_view(&Default::default())
        };
        let [stored, drawn] = [wgpu::TextureUsages::STORAGE_BINDING, wgpu::TextureUsages::RENDER_ATTACHMENT];
        self.views = Some([
            make("behind", 1, wgpu::TextureFormat::Rgba32Float, stored),
            make("nearest triangles", 2, IDS, drawn),
            make("depths", 2, DEPTHS, drawn),
        ]);
    }

    /// The textures behind the hair: [`Behind`], [`Ids`] and [`Depths`].
    pub fn views(&self) -> Result<&[wgpu::TextureView; 3], GpuRenderError> {
        let missing = || GpuRenderError::Failed("there is no texture for the bodies".to_owned());
        self.views.as_ref().ok_or_else(missing)
    }

    /// A bind group of `layout` with what is in `slots`.
    pub fn bind(
        &self,
        device: &wgpu::Device,
        layout: &wgpu::BindGroupLayout,
        slots: &[Slot],
    ) -> Result<wgpu::BindGroup, GpuRenderError> {
        let [behind, ids, depths] = self.views()?;
        let entry = |&slot: &Slot| {
            let resource = match slot {
                Behind => wgpu::BindingResource::TextureView(behind),
                Ids => wgpu::BindingResource::TextureView(ids),
                Depths => wgpu::BindingResource::TextureView(depths),
                _ => self.buffer(slot)?.as_entire_binding(),
            };
            Ok(wgpu::BindGroupEntry { binding: slot as u32, resource })
        };
        let entries: Vec<_> = slots.iter().map(entry).collect::<Result<_, GpuRenderError>>()?;
        Ok(device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries }))
    }

    /// Adds `stage` to `encoder`. `times` are a set of timestamps and the number of the first of
    /// two in it.
    pub fn encode(
        &self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        stage: &Stage,
        pipeline: &Pipeline,
        frame: &FrameData,
        times: Option<(&wgpu::QuerySet, u32)>,
    ) -> Result<(), GpuRenderError> {
        let bound = self.bind(device, &pipeline.layout(), stage.slots)?;
        match pipeline {
            Pipeline::Compute(pipeline) => {
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                    label: Some(stage.name),
                    timestamp_writes: times.map(|(query_set, first)| wgpu::ComputePassTimestampWrites {
                        query_set,
                        beginning_of_pass_write_index: Some(first),
                        end_of_pass_write_index: Some(first + 1),
                    }),
                });
                let [x, y] = stage.workgroups(frame);
                pass.set_pipeline(pipeline);
                pass.set_bind_group(0, &bound, &[]);
                if x > 0 && y > 0 {
                    pass.dispatch_workgroups(x, y, 1);
                }
            }
            Pipeline::Render(pipeline) => {
                let [_, ids, depths] = self.views()?;
                // The depths of a target are there already.
                let is_over = frame.target_near > 0.0;
                let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                    label: Some(stage.name),
                    color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                        view: ids,
                        depth_slice: None,
                        resolve_target: None,
                        ops: wgpu::Operations {
                            load: if is_over {
                                wgpu::LoadOp::Load
                            } else {
                                wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT)
                            },
                            store: wgpu::StoreOp::Store,
                        },
                    })],
                    depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                        view: depths,
                        depth_ops: Some(wgpu::Operations {
                            load: if is_over { wgpu::LoadOp::Load } else { wgpu::LoadOp::Clear(0.0) },
                            store: wgpu::StoreOp::Store,
                        }),
                        stencil_ops: None,
                    }),
                    timestamp_writes: times.map(|(query_set, first)| wgpu::RenderPassTimestampWrites {
                        query_set,
                        beginning_of_pass_write_index: Some(first),
                        end_of_pass_write_index: Some(first + 1),
                    }),
                    ..Default::default()
                });
                pass.set_pipeline(pipeline);
                pass.set_bind_group(0, &bound, &[]);
                pass.draw(0..3 * frame.faces, 0..1);
            }
        }
        Ok(())
    }
}

/// The largest buffer that a kernel can read, a multiple of [`UNIT`].
pub(super) fn most_bound(device: &wgpu::Device) -> u64 {
    let limits = device.limits();
    limits.max_storage_buffer_binding_size.min(limits.max_buffer_size) / UNIT * UNIT
}

/// What a slot holds, for messages.
fn described(slot: Slot) -> &'static str {
    match slot {
        Frame => "settings",
        Positions => "positions",
        Curves => "strands",
        Owners | Points => "drawn particles",
        Widths => "widths",
        Albedos => "colours",
        Lights => "lights",
        Grids => "grids of shadows",
        Heights => "shadow maps",
        Radiance => "lit particles",
        Counts | Offsets | Horizon => "tiles",
        List => "pieces of strands",
        Report => "counts",
        Deposits | Sweeps => "grids of optical depth",
        Samples => "strands of the grids",
        Behind | Ids | Depths | Meshes | Placements | Vertices | Faces => "bodies",
        Picture => "pixels",
    }
}
