//! The device that kernels run on.

use crate::GpuError;
use crate::kernels::Kernels;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Duration;

/// How long an answer may take that is on its way.
const PATIENCE: Duration = Duration::from_secs(10);

/// Which GPU to take.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Choice {
    /// The fastest there is; one on the CPU (software Vulkan) if there is no other.
    #[default]
    Fastest,
    /// The one that takes the least power.
    Frugal,
    /// The first whose name contains this, whatever the case.
    Named(String),
}

/// What has been made on a device, and read back from it, since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Buffers.
    pub buffers: u32,
    /// Pipelines.
    pub pipelines: u32,
    /// Times that the CPU waited for numbers.
    pub read_backs: u32,
}

/// A GPU, and what can be shared by all that runs on it.
///
/// Cheap to clone: clones are the same device.
#[derive(Clone, Debug)]
pub struct Gpu(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    device: wgpu::Device,
    queue: wgpu::Queue,
    name: String,
    is_software: bool,
    /// The first thing that went wrong.
    fault: Arc<Mutex<Option<String>>>,
    kernels: OnceLock<Kernels>,
    buffers: AtomicU32,
    pipelines: AtomicU32,
    read_backs: AtomicU32,
}

impl Gpu {
    /// Opens a GPU.
    ///
    /// # Errors
    /// [`GpuError::None`] if there is none, [`GpuError::Name`] if none has the name asked for, [`GpuError::Unfit`] if it cannot be opened.
    pub fn open(choice: &Choice) -> Result<Self, GpuError> {
        pollster::block_on(Self::open_async(choice))
    }

    /// The same where waiting is not allowed, as in a browser.
    ///
    /// # Errors
    /// As [`Gpu::open`].
    pub async fn open_async(choice: &Choice) -> Result<Self, GpuError> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
        let adapter = match choice {
            Choice::Named(name) => named(&instance, name).await?,
            Choice::Fastest | Choice::Frugal => {
                let options = wgpu::RequestAdapterOptions {
                    power_preference: if *choice == Choice::Frugal {
                        wgpu::PowerPreference::LowPower
                    } else {
                        wgpu::PowerPreference::HighPerformance
                    },
                    ..Default::default()
                };
                let adapter = instance.request_adapter(&options).await;
                adapter.map_err(|error| GpuError::None { reason: error.to_string() })?
            }
        };
        let (name, limits) = (adapter.get_info().name, adapter.limits());
        // WebGPU's limits, so that a browser can follow; larger buffers where there are.
        let needed = wgpu::Limits {
            max_storage_buffer_binding_size: limits.max_storage_buffer_binding_size,
            max_buffer_size: limits.max_buffer_size,
            ..wgpu::Limits::default()
        };
        let described = wgpu::DeviceDescriptor {
            label: Some("forelock"),
            required_features: adapter.features()
                & (wgpu::Features::TIMESTAMP_QUERY | wgpu::Features::SUBGROUP),
            required_limits: needed,
            memory_hints: wgpu::MemoryHints::Performance,
            ..Default::default()
        };
        let opened = adapter.request_device(&described).await;
        let (device, queue) =
            opened.map_err(|error| GpuError::Unfit { name: name.clone(), reason: error.to_string() })?;
        let fault = Arc::new(Mutex::new(None));
        let (own, lost) = (Arc::clone(&fault), Arc::clone(&fault));
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| note(&own, error.to_string())));
        device.set_device_lost_callback(move |_, text| note(&lost, format!("the device was lost ({text})")));
        Ok(Self::around(device, queue, (name, adapter.get_info().device_type), fault))
    }

    /// A device that someone else opened and looks after: an engine, a window, a trainer. Its faults go to its owner's handlers, not here: after one, frames do nothing.
    ///
    /// # Errors
    /// [`GpuError::Unfit`] if it has less than WebGPU's default limits.
    pub fn from_device(device: wgpu::Device, queue: wgpu::Queue) -> Result<Self, GpuError> {
        let info = device.adapter_info();
        let (own, needed) = (device.limits(), wgpu::Limits::default());
        if own.max_storage_buffers_per_shader_stage < needed.max_storage_buffers_per_shader_stage
            || own.max_uniform_buffer_binding_size < needed.max_uniform_buffer_binding_size
            || own.max_compute_invocations_per_workgroup < needed.max_compute_invocations_per_workgroup
        {
            let reason = "the device was opened with less than WebGPU's default limits".to_owned();
            return Err(GpuError::Unfit { name: info.name, reason });
        }
        Ok(Self::around(device, queue, (info.name, info.device_type), Arc::default()))
    }

    fn around(
        device: wgpu::Device,
        queue: wgpu::Queue,
        (name, kind): (String, wgpu::DeviceType),
        fault: Arc<Mutex<Option<String>>>,
    ) -> Self {
        Self(Arc::new(Inner {
            device,
            queue,
            name,
            is_software: kind == wgpu::DeviceType::Cpu,
            fault,
            kernels: OnceLock::new(),
            buffers: AtomicU32::new(0),
            pipelines: AtomicU32::new(0),
            read_backs: AtomicU32::new(0),
        }))
    }

    /// Names of all GPUs there are.
    pub fn names() -> Vec<String> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
        pollster::block_on(names(&instance)).into_iter().map(|(name, _)| name).collect()
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// Whether it is a processor that plays one.
    pub fn is_software(&self) -> bool {
        self.0.is_software
    }

    /// The device.
    pub fn device(&self) -> &wgpu::Device {
        &self.0.device
    }

    /// Its queue.
    pub fn queue(&self) -> &wgpu::Queue {
        &self.0.queue
    }

    /// What has been made on it so far.
    pub fn counts(&self) -> Counts {
        Counts {
            buffers: self.0.buffers.load(Relaxed),
            pipelines: self.0.pipelines.load(Relaxed),
            read_backs: self.0.read_backs.load(Relaxed),
        }
    }

    /// The kernels, made at the first call.
    pub(crate) fn kernels(&self) -> &Kernels {
        self.0.kernels.get_or_init(|| {
            let kernels = Kernels::new(&self.0.device);
            self.0.pipelines.fetch_add(kernels.count(), Relaxed);
            kernels
        })
    }

    /// Fails if something has gone wrong since the device was opened.
    ///
    /// # Errors
    /// [`GpuError::Failed`] with the first fault.
    pub fn check(&self) -> Result<(), GpuError> {
        match &*self.0.fault.lock().unwrap_or_else(PoisonError::into_inner) {
            None => Ok(()),
            Some(reason) => Err(self.failed(reason)),
        }
    }

    /// Marks the device as lost, as a driver would: for tests of what happens then.
    #[doc(hidden)]
    pub fn lose(&self, reason: &str) {
        note(&self.0.fault, format!("the device was lost ({reason})"));
    }

    fn failed(&self, reason: &str) -> GpuError {
        GpuError::Failed { name: self.0.name.clone(), reason: reason.to_owned() }
    }

    /// A buffer of `bytes`, all zero.
    pub(crate) fn buffer(&self, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
        self.0.buffers.fetch_add(1, Relaxed);
        let label = Some(label);
        self.0.device.create_buffer(&wgpu::BufferDescriptor {
            label,
            size: bytes,
            usage,
            mapped_at_creation: false,
        })
    }

    /// Waits until all is done that was handed to the device.
    ///
    /// # Errors
    /// [`GpuError::Failed`] if the device has failed.
    pub fn wait(&self) -> Result<(), GpuError> {
        self.check()?;
        // A device that is lost while one waits for it is a panic in wgpu.
        let wait = || self.0.device.poll(wgpu::PollType::wait_indefinitely());
        let polled = std::panic::catch_unwind(std::panic::AssertUnwindSafe(wait));
        self.check()?;
        let polled = polled.map_err(|_| self.failed("it was lost while it was waited for"))?;
        polled.map_err(|error| self.failed(&error.to_string()))?;
        Ok(())
    }

    /// The same, filled with `bytes`, or with nothing where there are none: a binding needs a buffer.
    pub(crate) fn filled(&self, label: &str, bytes: &[u8], usage: wgpu::BufferUsages) -> wgpu::Buffer {
        let buffer = self.buffer(label, bytes.len().max(4) as u64, usage | wgpu::BufferUsages::COPY_DST);
        self.0.queue.write_buffer(&buffer, 0, bytes);
        buffer
    }

    /// Bytes that it binds at once, at most.
    pub(crate) fn most_bound(&self) -> u64 {
        let limits = self.0.device.limits();
        limits.max_storage_buffer_binding_size.min(limits.max_buffer_size)
    }

    /// Fails if `what`, of so many `bytes`, is more than may be bound at once: `limit`, or what the device binds.
    pub(crate) fn check_room(&self, what: &'static str, bytes: u64, limit: u64) -> Result<(), GpuError> {
        let limit = limit.min(self.most_bound());
        if bytes > limit {
            return Err(GpuError::TooLarge { what, name: self.0.name.clone(), bytes, limit });
        }
        Ok(())
    }

    /// Copies `buffers` to the CPU, each to a list of bytes, and waits for them: once, where one buffer more has room for all.
    pub(crate) fn read(&self, buffers: &[&wgpu::Buffer]) -> Result<Vec<Vec<u8>>, GpuError> {
        let most = self.0.device.limits().max_buffer_size;
        let mut read = Vec::with_capacity(buffers.len());
        while read.len() < buffers.len() {
            let mut bytes = 0;
            let fits = buffers[read.len()..].iter().take_while(|buffer| {
                bytes += buffer.size();
                bytes <= most
            });
            let count = fits.count().max(1);
            read.extend(self.read_together(&buffers[read.len()..read.len() + count])?);
        }
        Ok(read)
    }

    fn read_together(&self, buffers: &[&wgpu::Buffer]) -> Result<Vec<Vec<u8>>, GpuError> {
        self.check()?;
        self.0.read_backs.fetch_add(1, Relaxed);
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let bytes = buffers.iter().map(|buffer| buffer.size()).sum();
        let staging = self.buffer("read-back", bytes, usage);
        let mut encoder = self.0.device.create_command_encoder(&Default::default());
        let mut first = 0;
        for buffer in buffers {
            encoder.copy_buffer_to_buffer(buffer, 0, &staging, first, buffer.size());
            first += buffer.size();
        }
        self.0.queue.submit([encoder.finish()]);
        let (tell, told) = std::sync::mpsc::channel();
        staging.map_async(wgpu::MapMode::Read, .., move |result| {
            // No one listens any more after an error.
            let _ = tell.send(result);
        });
        self.wait()?;
        // Another thread's waiting may have taken the answer, and be about to hand it on.
        match told.recv_timeout(PATIENCE) {
            Ok(Ok(())) => {
                let mapped = staging.get_mapped_range(..);
                let mut rest = &*mapped;
                let part = |buffer: &&wgpu::Buffer| {
                    let (own, others) = rest.split_at(buffer.size() as usize);
                    rest = others;
                    own.to_vec()
                };
                Ok(buffers.iter().map(part).collect())
            }
            Ok(Err(error)) => Err(self.failed(&error.to_string())),
            Err(_) => Err(self.failed("it did not answer")),
        }
    }
}

fn note(fault: &Mutex<Option<String>>, reason: String) {
    fault.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(reason);
}

async fn names(instance: &wgpu::Instance) -> Vec<(String, wgpu::Adapter)> {
    let adapters = instance.enumerate_adapters(wgpu::Backends::all()).await;
    adapters.into_iter().map(|adapter| (adapter.get_info().name, adapter)).collect()
}

async fn named(instance: &wgpu::Instance, name: &str) -> Result<wgpu::Adapter, GpuError> {
    let all = names(instance).await;
    let found: Vec<String> = all.iter().map(|(name, _)| name.clone()).collect();
    let fits = |(own, _): &(String, wgpu::Adapter)| own.to_lowercase().contains(&name.to_lowercase());
    let adapter = all.into_iter().find(fits).map(|(_, adapter)| adapter);
    adapter.ok_or_else(|| GpuError::Name { name: name.to_owned(), found })
}
