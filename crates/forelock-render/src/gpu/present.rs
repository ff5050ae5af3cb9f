//! Copies a picture to a target, or draws it over what the target holds.

use super::GpuRenderError;
use super::stages::{DEPTHS, FRAME, FULL_SCREEN, IDS, Memory, Slot, TONE, module};

/// What an engine has drawn, for [`GpuRenderer::render_over`](super::GpuRenderer::render_over).
///
/// Both textures have the size in the settings, one mip level and one sample a pixel. The scene's
/// camera must be that of the engine: a pinhole camera without jitter. Strands nearer to it than 2
/// % of the distance from its eye to its target are left out.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// A colour attachment that can be blended, with the usage `RENDER_ATTACHMENT`. `Rgba16Float`,
    /// `Rgba32Float` and `Rg11b10Ufloat` hold linear light times the exposure of the settings,
    /// before the film curve. Other formats hold what a display shows; those that do not encode
    /// sRGB blend encoded colours.
    pub colour: &'a wgpu::TextureView,
    /// The format of `colour`.
    pub format: wgpu::TextureFormat,
    /// Depths as `Depth32Float`, with the usages `RENDER_ATTACHMENT` and `TEXTURE_BINDING`: `near`
    /// over the distance along the view, 0 where nothing was drawn ("reversed" and infinite).
    pub depth: &'a wgpu::TextureView,
    /// The distance whose depth is 1, metres.
    pub near: f32,
}

impl Target<'_> {
    /// Checks that `device` can draw pictures of `size` pixels over it.
    pub(super) fn check(&self, device: &wgpu::Device, size: [u32; 2]) -> Result<(), GpuRenderError> {
        let wrong = |reason: String| Err(GpuRenderError::Target(reason));
        let depth = self.depth.texture();
        for (name, texture) in [("colour", self.colour.texture()), ("depth", depth)] {
            let found = [texture.width(), texture.height()];
            if found != size {
                return wrong(format!("its {name} has {found:?} pixels, but the picture {size:?}"));
            }
            if texture.sample_count() != 1 {
                return wrong(format!("its {name} has {} samples a pixel, not 1", texture.sample_count()));
            }
            if !texture.usage().contains(wgpu::TextureUsages::RENDER_ATTACHMENT) {
                return wrong(format!("its {name} lacks the usage RENDER_ATTACHMENT"));
            }
        }
        let own = self.colour.texture().format();
        if own.remove_srgb_suffix() != self.format.remove_srgb_suffix() {
            return wrong(format!("its colour is {own:?}, not {:?}", self.format));
        }
        let features = self.format.guaranteed_format_features(device.features());
        if !features.flags.contains(wgpu::TextureFormatFeatureFlags::BLENDABLE) {
            return wrong(format!("{:?} cannot be blended on this device", self.format));
        }
        if depth.format() != DEPTHS {
            return wrong(format!("its depth is {:?}, not {DEPTHS:?}", depth.format()));
        }
        if !depth.usage().contains(wgpu::TextureUsages::TEXTURE_BINDING) {
            return wrong("its depth lacks the usage TEXTURE_BINDING".to_owned());
        }
        if !(self.near > 0.0 && self.near.is_finite()) {
            return wrong(format!("`near` is {}, not a distance", self.near));
        }
        Ok(())
    }
}

/// Pipelines for targets, made at first use; some belong to the format of a target.
#[derive(Debug, Default)]
pub(super) struct Presenting {
    whole: Option<(wgpu::TextureFormat, wgpu::RenderPipeline)>,
    colour: Option<(wgpu::TextureFormat, wgpu::RenderPipeline)>,
    hide: Option<wgpu::RenderPipeline>,
    depth: Option<wgpu::RenderPipeline>,
}

/// A triangle that covers all pixels.
struct FullScreen {
    module: wgpu::ShaderModule,
    fragment: &'static str,
    colour: Option<wgpu::ColorTargetState>,
    depth: Option<wgpu::CompareFunction>,
}

impl FullScreen {
    fn pipeline(self, device: &wgpu::Device) -> wgpu::RenderPipeline {
        device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(self.fragment),
            layout: None,
            vertex: wgpu::VertexState {
                module: &self.module,
                entry_point: Some("corner"),
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: Default::default(),
            depth_stencil: self.depth.map(|compare| wgpu::DepthStencilState {
                format: DEPTHS,
                depth_write_enabled: Some(true),
                depth_compare: Some(compare),
                stencil: Default::default(),
                bias: Default::default(),
            }),
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &self.module,
                entry_point: Some(self.fragment),
                compilation_options: Default::default(),
                targets: self.colour.is_some().then_some(self.colour).as_slice(),
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}

/// The texts of the shaders that draw into targets, and that take their depths.
pub(super) const PRESENT: &[&str] = &[FRAME, FULL_SCREEN, TONE, include_str!("wgsl/present.wgsl")];
pub(super) const HIDE: &[&str] = &[FRAME, FULL_SCREEN, include_str!("wgsl/hide.wgsl")];

/// The entry point that draws over a target of `format`.
fn over(format: wgpu::TextureFormat) -> &'static str {
    use wgpu::TextureFormat::{Rg11b10Ufloat, Rgba16Float, Rgba32Float};
    match format {
        Rgba16Float | Rgba32Float | Rg11b10Ufloat => "light_over",
        format if format.is_srgb() => "linear_over",
        _ => "encoded_over",
    }
}

/// The pipeline for `format`, made anew if `own` is for another one.
fn of_format(
    own: &mut Option<(wgpu::TextureFormat, wgpu::RenderPipeline)>,
    format: wgpu::TextureFormat,
    make: impl FnOnce() -> wgpu::RenderPipeline,
) -> &wgpu::RenderPipeline {
    let kept = own.take().filter(|(of, _)| *of == format);
    &own.insert(kept.unwrap_or_else(|| (format, make()))).1
}

/// Begins a pass that draws into `colour` and `depth`; `load` tells what is done with what they
/// hold.
fn begin<'a>(
    encoder: &'a mut wgpu::CommandEncoder,
    label: &str,
    colour: Option<(&wgpu::TextureView, wgpu::LoadOp<wgpu::Color>)>,
    depth: Option<(&wgpu::TextureView, wgpu::LoadOp<f32>)>,
) -> wgpu::RenderPass<'a> {
    let store = wgpu::StoreOp::Store;
    let colour = colour.map(|(view, load)| wgpu::RenderPassColorAttachment {
        view,
        depth_slice: None,
        resolve_target: None,
        ops: wgpu::Operations { load, store },
    });
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some(label),
        color_attachments: if colour.is_some() { std::slice::from_ref(&colour) } else { &[] },
        depth_stencil_attachment: depth.map(|(view, load)| wgpu::RenderPassDepthStencilAttachment {
            view,
            depth_ops: Some(wgpu::Operations { load, store }),
            stencil_ops: None,
        }),
        ..Default::default()
    })
}

impl Presenting {
    /// Copies the picture to `view`, of `format`.
    pub fn copy(
        &mut self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        memory: &Memory,
        view: &wgpu::TextureView,
        format: wgpu::TextureFormat,
    ) -> Result<(), GpuRenderError> {
        let pipeline = of_format(&mut self.whole, format, || {
            let module = module(device, "present", PRESENT);
            let fragment = if format.is_srgb() { "linear" } else { "encoded" };
            FullScreen { module, fragment, colour: Some(format.into()), depth: None }.pipeline(device)
        });
        let bound = memory.bind(device, &pipeline.get_bind_group_layout(0), &[Slot::Frame, Slot::Picture])?;
        let clear = wgpu::LoadOp::Clear(wgpu::Color::BLACK);
        draw(&mut begin(encoder, "present", Some((view, clear)), None), pipeline, &bound);
        Ok(())
    }

    /// Makes what `target` holds hide what is drawn.
    pub fn hide(
        &mut self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        memory: &Memory,
        target: &Target<'_>,
    ) -> Result<(), GpuRenderError> {
        let pipeline = self.hide.get_or_insert_with(|| {
            let (module, depth) = (module(device, "hide", HIDE), Some(wgpu::CompareFunction::Always));
            FullScreen { module, fragment: "hide", colour: Some(IDS.into()), depth }.pipeline(device)
        });
        let frame = memory.buffer(Slot::Frame)?.as_entire_binding();
        let depth = wgpu::BindingResource::TextureView(target.depth);
        let entries =
            [(0, frame), (1, depth)].map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource });
        let bound = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("depths of the target"),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        let [_, ids, depths] = memory.views()?;
        let (none, far) = (wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT), wgpu::LoadOp::Clear(0.0));
        draw(&mut begin(encoder, "hide", Some((ids, none)), Some((depths, far))), pipeline, &bound);
        Ok(())
    }

    /// Draws the picture over what `target` holds.
    pub fn draw_over(
        &mut self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        memory: &Memory,
        target: &Target<'_>,
    ) -> Result<(), GpuRenderError> {
        let bind = |pipeline: &wgpu::RenderPipeline| {
            memory.bind(device, &pipeline.get_bind_group_layout(0), &[Slot::Frame, Slot::Picture])
        };
        let colour = of_format(&mut self.colour, target.format, || {
            let blend = Some(wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING);
            let colour = Some(wgpu::ColorTargetState { blend, ..target.format.into() });
            let (module, fragment) = (module(device, "present", PRESENT), over(target.format));
            FullScreen { module, fragment, colour, depth: None }.pipeline(device)
        });
        let blended = Some((target.colour, wgpu::LoadOp::Load));
        draw(&mut begin(encoder, "colours", blended, None), colour, &bind(colour)?);
        let depth = self.depth.get_or_insert_with(|| {
            let (module, depth) = (module(device, "present", PRESENT), Some(wgpu::CompareFunction::Greater));
            FullScreen { module, fragment: "depth_over", colour: None, depth }.pipeline(device)
        });
        let nearer = Some((target.depth, wgpu::LoadOp::Load));
        draw(&mut begin(encoder, "depths", None, nearer), depth, &bind(depth)?);
        Ok(())
    }
}

/// Draws the triangle that covers a target.
fn draw(pass: &mut wgpu::RenderPass<'_>, pipeline: &wgpu::RenderPipeline, bound: &wgpu::BindGroup) {
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, bound, &[]);
    pass.draw(0..3, 0..1);
}
