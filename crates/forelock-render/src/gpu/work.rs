//! The renderer: uploads a scene, runs the stages, reads the picture.

use std::sync::mpsc::{Receiver, TryRecvError};
use std::time::Duration;

use super::GpuRenderError;
use super::curves;
use super::hosted::{FrameData, Hosted, News};
use super::meshes::VertexData;
use super::present::{Presenting, Target};
use super::shared::{Gatherer, SharedPositions};
use super::stages::{Memory, PIECES_EACH, Pipeline, STAGES, Slot, most_bound};
use crate::image::Image;
use crate::scene::{Scene, Settings, Strands};

/// How long to wait for a callback that another thread may be running.
const PATIENCE: Duration = Duration::from_secs(10);
/// Numbers in a report of the device.
const REPORT: usize = 4;
const REPORT_BYTES: u64 = 4 * REPORT as u64;
/// Bytes of an item of the list of pieces.
const ITEM: u64 = 8;
/// The smallest list of pieces.
const FEWEST_ITEMS: u32 = 4096;

/// What the device told about a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameReport {
    /// Drawn particles.
    pub particles: u32,
    /// Pieces of strands in all tiles; a piece counts once in each tile that it touches.
    pub pieces: u32,
    /// Pieces that had no room in the list and were left out.
    pub dropped: u32,
    /// Milliseconds that the CPU took to choose strands and to upload what is new.
    pub prepare_ms: f64,
    /// Bytes that were uploaded.
    pub uploaded_bytes: u64,
    /// Bytes of the renderer's buffers and textures on the device.
    pub device_bytes: u64,
    /// Milliseconds of each stage; empty if the device has no timestamps.
    pub stages_ms: Vec<(&'static str, f64)>,
}

/// Two timestamps a stage.
#[derive(Debug)]
struct Clock {
    set: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    ms_per_tick: f64,
}

impl Clock {
    const BYTES: u64 = 16 * STAGES.len() as u64;

    fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Option<Self> {
        device.features().contains(wgpu::Features::TIMESTAMP_QUERY).then(|| Self {
            set: device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("stages"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * STAGES.len() as u32,
            }),
            resolved: device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("timestamps"),
                size: Self::BYTES,
                usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            }),
            ms_per_tick: f64::from(queue.get_timestamp_period()) * 1e-6,
        })
    }
}

/// Results on their way to the CPU.
#[derive(Debug)]
struct Reading {
    staging: wgpu::Buffer,
    receiver: Receiver<Result<(), wgpu::BufferAsyncError>>,
    frame: FrameData,
}

impl Reading {
    fn begin(staging: wgpu::Buffer, frame: FrameData) -> Self {
        let (sender, receiver) = std::sync::mpsc::channel();
        staging.map_async(wgpu::MapMode::Read, .., move |result| {
            // After an error the receiver is gone.
            let _ = sender.send(result);
        });
        Self { staging, receiver, frame }
    }
}

fn failed(error: impl std::fmt::Display) -> GpuRenderError {
    GpuRenderError::Failed(error.to_string())
}

/// Draws hair on a GPU.
#[derive(Debug)]
pub struct GpuRenderer {
    device: wgpu::Device,
    queue: wgpu::Queue,
    pipelines: Vec<Pipeline>,
    hosted: Hosted,
    presenting: Presenting,
    /// Groups whose positions are on the device.
    shared: Vec<(usize, SharedPositions)>,
    /// Made at first use.
    gatherer: Option<Gatherer>,
    memory: Memory,
    clock: Option<Clock>,
    /// Room in the list of pieces, if it was set.
    limit: Option<u32>,
    /// Room in the list of pieces.
    capacity: u32,
    /// What was uploaded last.
    frame: Option<FrameData>,
    prepare_ms: f64,
    uploaded_bytes: u64,
    /// The report of a frame that was not waited for.
    pending: Option<Reading>,
    report: FrameReport,
}

impl GpuRenderer {
    /// A renderer on `device`. Compiles its kernels. An error of the device goes to the handler of
    /// its owner.
    pub fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Self {
        Self {
            device: device.clone(),
            queue: queue.clone(),
            pipelines: STAGES.iter().map(|stage| Pipeline::new(device, stage)).collect(),
            hosted: Hosted::default(),
            presenting: Presenting::default(),
            shared: Vec::new(),
            gatherer: None,
            memory: Memory::default(),
            clock: Clock::new(device, queue),
            limit: None,
            capacity: 0,
            frame: None,
            prepare_ms: 0.0,
            uploaded_bytes: 0,
            pending: None,
            report: FrameReport::default(),
        }
    }

    /// Never makes room for more than `pieces` pieces of strands; `None` (default) sets no limit
    /// but the device's. Those without room are not drawn; [`report`](Self::report) counts them.
    pub fn limit_pieces(&mut self, pieces: Option<u32>) {
        self.limit = pieces;
        self.capacity = 0;
    }

    /// What the device told about the last frame whose report has been read.
    pub fn report(&self) -> &FrameReport {
        &self.report
    }

    /// Draws `scene` and waits for the picture.
    ///
    /// # Errors
    /// [`GpuRenderError::Scene`] as [`render`](crate::render); [`GpuRenderError::TooLarge`] if the
    /// device has no room; [`GpuRenderError::Failed`] if it failed.
    pub fn render(&mut self, scene: &Scene<'_>, settings: &Settings) -> Result<Image, GpuRenderError> {
        self.pending = None;
        self.prepare(scene, settings, 0.0)?;
        self.redraw()
    }

    /// Draws the last picture once more, without preparing and uploading it again.
    ///
    /// # Errors
    /// [`GpuRenderError::Failed`] if nothing has been drawn, or the last was by
    /// [`render_over`](Self::render_over), or the device failed;
    /// [`GpuRenderError::TooLarge`] if it has no room.
    pub fn redraw(&mut self) -> Result<Image, GpuRenderError> {
        let mut frame = self.frame.ok_or_else(|| failed("there is no picture to draw again"))?;
        frame.capacity = self.capacity;
        loop {
            let mut encoder = self.device.create_command_encoder(&Default::default());
            self.encode(&mut encoder, &frame)?;
            let pixels = self.finish(encoder, &frame)?;
            if self.report.dropped == 0 || !self.grow(&mut frame)? {
                return Ok(Image::from_rgba(frame.size[0], frame.size[1], pixels)?);
            }
        }
    }

    /// Draws `scene` into `target`, a view of `format` with the size in `settings`, and does not
    /// wait. All of the target is overwritten. The next call reads the report of this frame.
    ///
    /// # Errors
    /// The same errors as [`render`](Self::render).
    pub fn render_to(
        &mut self,
        scene: &Scene<'_>,
        settings: &Settings,
        target: &wgpu::TextureView,
        format: wgpu::TextureFormat,
    ) -> Result<(), GpuRenderError> {
        self.collect()?;
        let frame = self.prepare(scene, settings, 0.0)?;
        let mut encoder = self.device.create_command_encoder(&Default::default());
        self.encode(&mut encoder, &frame)?;
        self.presenting.copy(&self.device, &mut encoder, &self.memory, target, format)?;
        self.submit(encoder, frame)
    }

    /// Draws `scene` over what `target` holds, and does not wait: strands and bodies, without the
    /// backdrop. What is nearer there hides them. A head is drawn either by the engine or as a body
    /// of the scene, whose shadow is on the hair, not by both, since their depths are nearly equal.
    /// Its depth becomes theirs where they hide at least half of a pixel. The next call reads the
    /// report of this frame.
    ///
    /// # Errors
    /// [`GpuRenderError::Target`] if `target` does not fit; else the same errors as
    /// [`render`](Self::render).
    pub fn render_over(
        &mut self,
        scene: &Scene<'_>,
        settings: &Settings,
        target: &Target<'_>,
    ) -> Result<(), GpuRenderError> {
        target.check(&self.device, [settings.width, settings.height])?;
        self.collect()?;
        let frame = self.prepare(scene, settings, target.near)?;
        // What it draws cannot be read as a picture.
        self.frame = None;
        let mut encoder = self.device.create_command_encoder(&Default::default());
        self.presenting.hide(&self.device, &mut encoder, &self.memory, target)?;
        self.encode(&mut encoder, &frame)?;
        self.presenting.draw_over(&self.device, &mut encoder, &self.memory, target)?;
        self.submit(encoder, frame)
    }

    /// Takes the positions of group number `group` of all later scenes from the device; with `None`
    /// (default) from the scene. Call it after each frame of a simulation, with the origin of that
    /// frame. Positions in the scene only choose what is drawn, by the box around them and their
    /// distance from the camera: they may be those of an earlier frame, or of the rest shape where
    /// the head is.
    pub fn share(&mut self, group: usize, positions: Option<SharedPositions>) {
        self.shared.retain(|(own, _)| *own != group);
        self.shared.extend(positions.map(|positions| (group, positions)));
    }

    /// Submits a frame that is not waited for.
    fn submit(&mut self, mut encoder: wgpu::CommandEncoder, frame: FrameData) -> Result<(), GpuRenderError> {
        // One report at a time: a frame that comes before it is read has none.
        let staging = match &self.pending {
            None => Some(self.copy_results(&mut encoder, 0)?),
            Some(_) => None,
        };
        self.queue.submit([encoder.finish()]);
        if let Some(staging) = staging {
            self.pending = Some(Reading::begin(staging, frame));
        }
        Ok(())
    }

    /// Makes room for the pieces that had none. Returns false if the limit is reached.
    fn grow(&mut self, frame: &mut FrameData) -> Result<bool, GpuRenderError> {
        let most = self.most_items();
        if self.capacity >= most {
            return Ok(false);
        }
        self.capacity = self.report.pieces.min(most);
        frame.capacity = self.capacity;
        self.memory.reserve(&self.device, Slot::List, u64::from(self.capacity) * ITEM)?;
        self.queue.write_buffer(self.memory.buffer(Slot::Frame)?, 0, bytemuck::bytes_of(frame));
        Ok(true)
    }

    /// The largest list of pieces.
    fn most_items(&self) -> u32 {
        let room = (most_bound(&self.device) / ITEM).min(u64::from(u32::MAX / 2)) as u32;
        self.limit.map_or(room, |limit| limit.min(room))
    }

    /// Computes on the CPU what the device needs, and uploads what of it is new. `target_near` is
    /// that of the target that is drawn over, 0 without one.
    fn prepare(
        &mut self,
        scene: &Scene<'_>,
        settings: &Settings,
        target_near: f32,
    ) -> Result<FrameData, GpuRenderError> {
        let started = std::time::Instant::now();
        (self.frame, self.uploaded_bytes) = (None, 0);
        // After an error nothing is known of what the device has.
        let mut hosted = std::mem::take(&mut self.hosted);
        let news = hosted.update(scene, settings, &self.shared)?;
        hosted.frame.target_near = target_near;
        let frame = self.upload(scene, &hosted, news)?;
        self.hosted = hosted;
        self.frame = Some(frame);
        self.prepare_ms = started.elapsed().as_secs_f64() * 1e3;
        Ok(frame)
    }

    fn upload(
        &mut self,
        scene: &Scene<'_>,
        hosted: &Hosted,
        news: News,
    ) -> Result<FrameData, GpuRenderError> {
        let Hosted { frame, hair, light, bodies } = hosted;
        let mut frame = *frame;
        if frame.points > u32::MAX / PIECES_EACH {
            let limit = u64::from(u32::MAX / PIECES_EACH);
            let bytes = u64::from(frame.points);
            return Err(GpuRenderError::TooLarge { what: "drawn particles", bytes, limit });
        }
        // Less light where memory is short.
        let lit_room = most_bound(&self.device) / (8 * u64::from(frame.points.max(1)));
        frame.lit_each = frame.lit_each.min(lit_room.min(16) as u32).max(1);
        let guess = frame.points.saturating_mul(2).max(FEWEST_ITEMS);
        self.capacity = self.capacity.max(guess).min(self.most_items());
        frame.capacity = self.capacity;
        self.write(Slot::Frame, bytemuck::bytes_of(&frame))?;
        self.write_positions(scene)?;
        let is_new = news.hair == curves::News::All;
        self.write_new(is_new, Slot::Owners, bytemuck::cast_slice(&hair.owners))?;
        self.write_new(is_new, Slot::Widths, bytemuck::cast_slice(&hair.widths))?;
        self.write_new(is_new, Slot::Albedos, bytemuck::cast_slice(&hair.albedos))?;
        let is_new = news.hair != curves::News::Nothing;
        self.write_new(is_new, Slot::Curves, bytemuck::cast_slice(&hair.curves))?;
        self.write(Slot::Lights, bytemuck::cast_slice(&light.lights))?;
        self.write(Slot::Samples, bytemuck::cast_slice(&light.samples))?;
        self.write(Slot::Sweeps, bytemuck::cast_slice(&light.sweeps))?;
        self.write_new(news.bodies.faces, Slot::Faces, bytemuck::cast_slice(&bodies.faces))?;
        self.write_new(news.bodies.vertices, Slot::Meshes, bytemuck::cast_slice(&bodies.vertices))?;
        self.write(Slot::Placements, bytemuck::cast_slice(&bodies.placements))?;
        let tiles = u64::from(frame.tiles[0]) * u64::from(frame.tiles[1]);
        let pixels = u64::from(frame.size[0]) * u64::from(frame.size[1]);
        let points = u64::from(frame.points);
        let [heights, grids, deposits] = light.room.map(|numbers| 4 * numbers as u64);
        let vertices = u64::from(frame.vertices) * size_of::<VertexData>() as u64;
        let room = [
            (Slot::Vertices, vertices),
            (Slot::Heights, heights),
            (Slot::Grids, grids),
            (Slot::Deposits, deposits),
            (Slot::Points, 16 * points),
            (Slot::Radiance, 8 * points * u64::from(frame.lit_each)),
            (Slot::Horizon, 4 * tiles),
            (Slot::Counts, 4 * tiles),
            (Slot::Offsets, 4 * (tiles + 1)),
            (Slot::List, u64::from(self.capacity) * ITEM),
            (Slot::Report, REPORT_BYTES),
            (Slot::Picture, if frame.target_near > 0.0 { 12 * pixels } else { 4 * pixels }),
        ];
        for (slot, bytes) in room {
            self.memory.reserve(&self.device, slot, bytes)?;
        }
        self.memory.size_textures(&self.device, frame.size);
        Ok(frame)
    }

    /// Writes the positions of all groups, one after the other.
    fn write_positions(&mut self, scene: &Scene<'_>) -> Result<(), GpuRenderError> {
        let bytes = |strands: &Strands<'_>| size_of_val(strands.positions) as u64;
        self.memory.reserve(&self.device, Slot::Positions, scene.strands.iter().map(bytes).sum())?;
        let buffer = self.memory.buffer(Slot::Positions)?;
        let mut at = 0;
        let mut shared = Vec::new();
        for (group, strands) in scene.strands.iter().enumerate() {
            match self.shared.iter().find(|(own, _)| *own == group) {
                None => {
                    self.queue.write_buffer(buffer, at, bytemuck::cast_slice(strands.positions));
                    self.uploaded_bytes += bytes(strands);
                }
                Some((_, own)) => {
                    own.check(group, strands.positions.len())?;
                    shared.push(((at / 4) as u32, own));
                }
            }
            at += bytes(strands);
        }
        if !shared.is_empty() {
            let gatherer = self.gatherer.get_or_insert_with(|| Gatherer::new(&self.device));
            gatherer.gather(&self.device, &self.queue, buffer, &shared);
        }
        Ok(())
    }

    /// Writes `bytes` if they are new, or the first.
    fn write_new(&mut self, is_new: bool, slot: Slot, bytes: &[u8]) -> Result<(), GpuRenderError> {
        if is_new || self.memory.buffer(slot).is_err() { self.write(slot, bytes) } else { Ok(()) }
    }

    fn write(&mut self, slot: Slot, bytes: &[u8]) -> Result<(), GpuRenderError> {
        self.memory.reserve(&self.device, slot, bytes.len() as u64)?;
        self.queue.write_buffer(self.memory.buffer(slot)?, 0, bytes);
        self.uploaded_bytes += bytes.len() as u64;
        Ok(())
    }

    fn encode(&self, encoder: &mut wgpu::CommandEncoder, frame: &FrameData) -> Result<(), GpuRenderError> {
        for slot in [Slot::Counts, Slot::Heights, Slot::Deposits] {
            encoder.clear_buffer(self.memory.buffer(slot)?, 0, None);
        }
        for (index, (stage, pipeline)) in STAGES.iter().zip(&self.pipelines).enumerate() {
            let times = self.clock.as_ref().map(|clock| (&clock.set, 2 * index as u32));
            self.memory.encode(&self.device, encoder, stage, pipeline, frame, times)?;
        }
        Ok(())
    }

    /// Submits the frame and reads its picture and its report.
    fn finish(
        &mut self,
        mut encoder: wgpu::CommandEncoder,
        frame: &FrameData,
    ) -> Result<Vec<u8>, GpuRenderError> {
        let pixels = 4 * u64::from(frame.size[0]) * u64::from(frame.size[1]);
        let staging = self.copy_results(&mut encoder, pixels)?;
        self.queue.submit([encoder.finish()]);
        let reading = Reading::begin(staging, *frame);
        self.poll(wgpu::PollType::wait_indefinitely())?;
        // The wait of another thread may be running the callback.
        let mapped = reading.receiver.recv_timeout(PATIENCE).map_err(failed)?;
        mapped.map_err(failed)?;
        let bytes = reading.staging.get_mapped_range(..);
        self.report = self.read_report(&bytes, frame);
        Ok(bytes[(REPORT_BYTES + Clock::BYTES) as usize..][..pixels as usize].to_vec())
    }

    /// Copies the report and `pixels` bytes of the picture to a buffer that the CPU can read.
    fn copy_results(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        pixels: u64,
    ) -> Result<wgpu::Buffer, GpuRenderError> {
        let staging = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("picture read-back"),
            size: (REPORT_BYTES + Clock::BYTES + pixels).next_multiple_of(8),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        encoder.copy_buffer_to_buffer(self.memory.buffer(Slot::Report)?, 0, &staging, 0, REPORT_BYTES);
        if let Some(clock) = &self.clock {
            encoder.resolve_query_set(&clock.set, 0..2 * STAGES.len() as u32, &clock.resolved, 0);
            encoder.copy_buffer_to_buffer(&clock.resolved, 0, &staging, REPORT_BYTES, Clock::BYTES);
        }
        if pixels > 0 {
            let picture = self.memory.buffer(Slot::Picture)?;
            encoder.copy_buffer_to_buffer(picture, 0, &staging, REPORT_BYTES + Clock::BYTES, pixels);
        }
        Ok(staging)
    }

    /// Reads the report of the last frame that was not waited for, if the device is done
    /// with it, and makes room for the pieces that had none.
    fn collect(&mut self) -> Result<(), GpuRenderError> {
        let Some(reading) = self.pending.take() else { return Ok(()) };
        self.poll(wgpu::PollType::Poll)?;
        match reading.receiver.try_recv() {
            Ok(mapped) => mapped.map_err(failed)?,
            Err(TryRecvError::Empty) => {
                self.pending = Some(reading);
                return Ok(());
            }
            Err(error @ TryRecvError::Disconnected) => return Err(failed(error)),
        }
        let bytes = reading.staging.get_mapped_range(..).to_vec();
        self.report = self.read_report(&bytes, &reading.frame);
        if self.report.dropped > 0 {
            self.capacity = self.capacity.max(self.report.pieces.min(self.most_items()));
        }
        Ok(())
    }

    /// wgpu panics if the device is lost during a wait.
    fn poll(&self, how: wgpu::PollType) -> Result<(), GpuRenderError> {
        let poll = || self.device.poll(how);
        let polled = std::panic::catch_unwind(std::panic::AssertUnwindSafe(poll));
        polled.map_err(|_| failed("it was lost"))?.map_err(failed)?;
        Ok(())
    }

    fn read_report(&self, bytes: &[u8], frame: &FrameData) -> FrameReport {
        let (numbers, rest) = bytes.split_at(4 * REPORT);
        let numbers: Vec<u32> = bytemuck::pod_collect_to_vec(numbers);
        let ticks: Vec<[u64; 2]> = bytemuck::pod_collect_to_vec(&rest[..Clock::BYTES as usize]);
        let times = self.clock.iter().flat_map(|clock| {
            let ms = |[from, to]: [u64; 2]| to.saturating_sub(from) as f64 * clock.ms_per_tick;
            STAGES.iter().zip(&ticks).map(move |(stage, &ticks)| (stage.name, ms(ticks)))
        });
        FrameReport {
            particles: frame.points,
            pieces: numbers[0],
            dropped: numbers[1],
            prepare_ms: self.prepare_ms,
            uploaded_bytes: self.uploaded_bytes,
            device_bytes: self.memory.bytes(),
            stages_ms: times.collect(),
        }
    }
}
