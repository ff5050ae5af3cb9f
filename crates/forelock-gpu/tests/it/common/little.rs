//! A device that binds little at once.

use forelock_gpu::Gpu;

/// A device of the same GPU that binds no more than `bytes` at once, opened by someone else.
pub fn binding_little(gpu: &Gpu, bytes: u64) -> Gpu {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
    let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    let adapter = adapters.into_iter().find(|adapter| adapter.get_info().name == gpu.name());
    let required_limits = wgpu::Limits { max_storage_buffer_binding_size: bytes, ..wgpu::Limits::default() };
    let small = wgpu::DeviceDescriptor { required_limits, ..Default::default() };
    let opened = adapter.map(|adapter| pollster::block_on(adapter.request_device(&small)));
    let Some(Ok((device, queue))) = opened else { panic!("{} opens but once", gpu.name()) };
    Gpu::from_device(device, queue).unwrap_or_else(|error| panic!("{error}"))
}
