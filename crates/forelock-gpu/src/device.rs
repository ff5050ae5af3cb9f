//! The device that kernels run on.

use crate::GpuError;
use crate::kernel::KernelDef;
use crate::pipelines::Pipelines;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// How long to wait for a callback that another thread may be running.
const PATIENCE: Duration = Duration::from_secs(10);

/// Which GPU to open.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Choice {
    /// The fastest; a software rasterizer if there is no other.
    #[default]
    Fastest,
    /// The one that uses the least power.
    Frugal,
    /// The first whose name contains this, ignoring case.
    Named(String),
}

/// Resources made on a device and read-backs since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Buffers.
    pub buffers: u32,
    /// Pipelines.
    pub pipelines: u32,
    /// Times that the CPU waited for data.
    pub read_backs: u32,
}

/// A GPU and the pipelines made on it.
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
    /// The first error.
    fault: Arc<Mutex<Option<String>>>,
    pipelines: Pipelines,
    buffers: AtomicU32,
    read_backs: AtomicU32,
}

impl Gpu {
    /// Opens a GPU.
    ///
    /// # Errors
    /// [`GpuError::None`] if there is none, [`GpuError::Name`] if none has the requested name,
    /// [`GpuError::Unfit`] if it cannot be opened.
    pub fn open(choice: &Choice) -> Result<Self, GpuError> {
        pollster::block_on(Self::open_async(choice))
    }

    /// The same without blocking, as a browser requires.
    ///
    /// # Errors
    /// The same errors as [`Gpu::open`].
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
        // WebGPU's default limits, with the largest buffers that the adapter allows.
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
        Ok(Self::around(device, queue, fault))
    }

    /// A device that the caller opened and owns, as an engine or a window does. Its errors go to
    /// the owner's handlers, not here; after one, frames do nothing.
    ///
    /// # Errors
    /// [`GpuError::Unfit`] if its limits are below WebGPU's defaults.
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
        Ok(Self::around(device, queue, Arc::default()))
    }

    fn around(device: wgpu::Device, queue: wgpu::Queue, fault: Arc<Mutex<Option<String>>>) -> Self {
        let info = device.adapter_info();
        Self(Arc::new(Inner {
            device,
            queue,
            name: info.name,
            is_software: info.device_type == wgpu::DeviceType::Cpu,
            fault,
            pipelines: Pipelines::default(),
            buffers: AtomicU32::new(0),
            read_backs: AtomicU32::new(0),
        }))
    }

    /// Names of all GPUs.
    pub fn names() -> Vec<String> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
        pollster::block_on(names(&instance)).into_iter().map(|(name, _)| name).collect()
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// Whether it is a software rasterizer.
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

    /// Resources made on it so far.
    pub fn counts(&self) -> Counts {
        Counts {
            buffers: self.0.buffers.load(Relaxed),
            pipelines: self.0.pipelines.kernels().len() as u32,
            read_backs: self.0.read_backs.load(Relaxed),
        }
    }

    /// The kernels whose pipelines were made on this device, in the order in which they were made:
    /// each at its first use.
    pub fn made_pipelines(&self) -> Vec<&'static KernelDef> {
        self.0.pipelines.kernels()
    }

    /// Its pipelines.
    pub(crate) fn pipelines(&self) -> &Pipelines {
        &self.0.pipelines
    }

    /// Bytes from one element of a dynamic uniform to the next.
    pub(crate) fn uniform_stride(&self, bytes: usize) -> u32 {
        (bytes as u32).next_multiple_of(self.0.device.limits().min_uniform_buffer_offset_alignment)
    }

    /// Fails if there was an error since the device was opened.
    ///
    /// # Errors
    /// [`GpuError::Failed`] with the first error.
    pub fn check(&self) -> Result<(), GpuError> {
        match &*self.0.fault.lock().unwrap_or_else(PoisonError::into_inner) {
            None => Ok(()),
            Some(reason) => Err(self.failed(reason)),
        }
    }

    /// Marks the device as lost, as a driver would; for tests.
    #[doc(hidden)]
    pub fn lose(&self, reason: &str) {
        note(&self.0.fault, format!("the device was lost ({reason})"));
    }

    pub(crate) fn failed(&self, reason: &str) -> GpuError {
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

    /// Waits until all submitted work is done.
    ///
    /// # Errors
    /// [`GpuError::Failed`] if the device has failed.
    pub fn wait(&self) -> Result<(), GpuError> {
        self.check()?;
        // wgpu panics if the device is lost during the wait.
        let wait = || self.0.device.poll(wgpu::PollType::wait_indefinitely());
        let polled = std::panic::catch_unwind(std::panic::AssertUnwindSafe(wait));
        self.check()?;
        let polled = polled.map_err(|_| self.failed("it was lost during a wait"))?;
        polled.map_err(|error| self.failed(&error.to_string()))?;
        Ok(())
    }

    /// Lets the device report what it has finished, and does not wait.
    ///
    /// # Errors
    /// [`GpuError::Failed`] if the device has failed.
    pub fn poll(&self) -> Result<(), GpuError> {
        self.check()?;
        let poll = || self.0.device.poll(wgpu::PollType::Poll);
        let polled = std::panic::catch_unwind(std::panic::AssertUnwindSafe(poll));
        self.check()?;
        let polled = polled.map_err(|_| self.failed("it was lost"))?;
        polled.map_err(|error| self.failed(&error.to_string()))?;
        Ok(())
    }

    /// A buffer filled with `bytes`; of four zeros if there are none, because a binding needs a
    /// buffer.
    pub(crate) fn filled(&self, label: &str, bytes: &[u8], usage: wgpu::BufferUsages) -> wgpu::Buffer {
        let buffer = self.buffer(label, bytes.len().max(4) as u64, usage | wgpu::BufferUsages::COPY_DST);
        self.0.queue.write_buffer(&buffer, 0, bytes);
        buffer
    }

    /// Bytes of the largest binding.
    pub(crate) fn most_bound(&self) -> u64 {
        let limits = self.0.device.limits();
        limits.max_storage_buffer_binding_size.min(limits.max_buffer_size)
    }

    /// Fails if the size of `what`, `bytes`, exceeds `limit` or the largest binding.
    pub(crate) fn check_room(&self, what: &'static str, bytes: u64, limit: u64) -> Result<(), GpuError> {
        let limit = limit.min(self.most_bound());
        if bytes > limit {
            return Err(GpuError::TooLarge { what, name: self.0.name.clone(), bytes, limit });
        }
        Ok(())
    }

    /// Copies `buffers` to the CPU and waits for them: once, if one staging buffer has room for
    /// all.
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
        let (sender, receiver) = std::sync::mpsc::channel();
        staging.map_async(wgpu::MapMode::Read, .., move |result| {
            // After an error the receiver is gone.
            let _ = sender.send(result);
        });
        self.wait()?;
        // The wait of another thread may be running the callback.
        match receiver.recv_timeout(PATIENCE) {
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
