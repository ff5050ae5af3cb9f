//! Kernels as typed values: a [`Shader`] is WGSL text with its constants and bindings, a `Kernel`
//! is one of its entry points.
//!
//! # Practice
//! Each module that owns kernels declares its bindings with `bindings!` and its shaders with
//! `shader!`. `bindings!` makes a struct with one buffer a field, named as the WGSL variable: a
//! bind group is made from the whole struct, so a missing or misspelt buffer does not compile. A
//! kernel carries the type of its bindings, so it cannot be dispatched with the bind group of
//! another. A test compares names, numbers, access and sizes with naga's reflection of the WGSL.
//!
//! No module lists all kernels. [`shaders`](crate::shaders) collects the tables of the modules for
//! tests and tools.

use crate::Gpu;
use crate::frame::COMMON_CONSTANTS;
use forelock_core::frame::{PRELUDE_WGSL, REDUCE_SUBGROUPS_WGSL, REDUCE_WGSL};
use std::fmt;
use std::marker::PhantomData;

/// Threads of a workgroup whose threads are strands.
pub const WORKGROUP: u32 = 64;
/// Threads of a workgroup that iterates over cells or a list.
pub const CELLS_GROUP: u32 = 256;
/// Threads of a dispatch over cells; each thread takes every so manieth cell.
pub const CELLS_THREADS: u32 = 512 * CELLS_GROUP;
/// Threads of a dispatch over a list: of cells under pressure, of contacts.
pub const LIST_THREADS: u32 = 128 * CELLS_GROUP;
/// Maximum number of dynamic uniforms of a bind group.
const MAX_DYNAMIC: usize = 2;

/// A constant that a shader takes from Rust.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Constant {
    /// Its WGSL name.
    pub name: &'static str,
    /// Its type and value.
    pub value: Value,
}

/// A constant's type and value.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(missing_docs, reason = "named as WGSL names them")]
pub enum Value {
    Bool(bool),
    I32(i32),
    U32(u32),
    F32(f32),
}

impl Constant {
    /// A `bool`.
    pub const fn bool(name: &'static str, value: bool) -> Self {
        Self { name, value: Value::Bool(value) }
    }

    /// An `i32`.
    pub const fn i32(name: &'static str, value: i32) -> Self {
        Self { name, value: Value::I32(value) }
    }

    /// A `u32`.
    pub const fn u32(name: &'static str, value: u32) -> Self {
        Self { name, value: Value::U32(value) }
    }

    /// An `f32`.
    pub const fn f32(name: &'static str, value: f32) -> Self {
        Self { name, value: Value::F32(value) }
    }
}

impl fmt::Display for Constant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = self.name;
        match self.value {
            Value::Bool(value) => write!(f, "const {name}: bool = {value};"),
            Value::I32(value) => write!(f, "const {name}: i32 = {value};"),
            Value::U32(value) => write!(f, "const {name}: u32 = {value}u;"),
            Value::F32(value) => write!(f, "const {name}: f32 = {value:e}f;"),
        }
    }
}

/// What a binding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BindingKind {
    /// A uniform struct, with its size in bytes.
    Uniform(usize),
    /// An element of an array of such structs, selected by a dynamic offset at each dispatch.
    DynamicUniform(usize),
    /// Storage that kernels read.
    Read,
    /// Storage that kernels read and write.
    ReadWrite,
}

impl BindingKind {
    /// Whether it is a storage buffer.
    pub const fn is_storage(self) -> bool {
        matches!(self, Self::Read | Self::ReadWrite)
    }

    /// Bytes of the uniform struct; 0 for storage.
    pub const fn size(self) -> usize {
        match self {
            Self::Uniform(size) | Self::DynamicUniform(size) => size,
            Self::Read | Self::ReadWrite => 0,
        }
    }
}

/// A binding of group 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Binding {
    /// Its number in WGSL.
    pub number: u32,
    /// The name of the WGSL variable.
    pub name: &'static str,
    /// What it is.
    pub kind: BindingKind,
}

/// All bindings of a shader, in the order of their numbers.
#[derive(Debug)]
pub struct BindingLayout {
    /// The struct that supplies the buffers.
    pub name: &'static str,
    /// The bindings; at most eight of storage, as many as WebGPU guarantees.
    pub bindings: &'static [Binding],
}

/// What the threads of a kernel are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Threads {
    /// Strands of a batch, along x.
    Strands,
    /// Strands of a batch along x, particles of its longest strand along y.
    StrandParticles,
    /// So many workgroups, whatever the batch.
    Workgroups(u32),
}

impl Threads {
    /// One workgroup.
    pub const ONCE: Self = Self::Workgroups(1);
    /// [`CELLS_THREADS`] threads.
    pub const CELLS: Self = Self::Workgroups(CELLS_THREADS / CELLS_GROUP);
    /// [`LIST_THREADS`] threads.
    pub const LIST: Self = Self::Workgroups(LIST_THREADS / CELLS_GROUP);

    /// At least `count` threads, in workgroups of [`WORKGROUP`].
    pub const fn count(count: u32) -> Self {
        Self::Workgroups(count.div_ceil(WORKGROUP))
    }

    /// Workgroups along x and y for a batch.
    fn workgroups(self, strands: StrandThreads) -> [u32; 2] {
        match self {
            Self::Strands => [strands.workgroups, 1],
            Self::StrandParticles => [strands.workgroups, strands.longest],
            Self::Workgroups(count) => [count, 1],
        }
    }
}

/// A shader module: text, constants, bindings and entry points.
#[derive(Debug)]
pub struct Shader {
    /// The stage that it belongs to: the name in reports, labels and timings. Several shaders may
    /// share one.
    pub stage: &'static str,
    /// WGSL after the constants and the prelude.
    pub texts: &'static [&'static str],
    /// Constants in addition to the common ones.
    pub constants: &'static [&'static [Constant]],
    /// Its bindings.
    pub layout: &'static BindingLayout,
    /// Its entry points.
    pub kernels: &'static [&'static KernelDef],
}

impl Shader {
    /// The whole WGSL: constants, prelude, texts; for a device that has `subgroups` or not.
    pub fn source(&self, subgroups: bool) -> String {
        let mut source = String::new();
        for constant in COMMON_CONSTANTS.iter().chain(self.constants).copied().flatten() {
            source.push_str(&constant.to_string());
            source.push('\n');
        }
        source.push_str(PRELUDE_WGSL);
        source.push_str(if subgroups { REDUCE_SUBGROUPS_WGSL } else { REDUCE_WGSL });
        source.extend(self.texts.iter().copied());
        source
    }
}

/// An entry point of a shader.
#[derive(Debug)]
pub struct KernelDef {
    /// The shader.
    pub shader: &'static Shader,
    /// The name of the entry point.
    pub entry: &'static str,
    /// What its threads are.
    pub threads: Threads,
}

/// An entry point with the type of its bindings.
#[derive(Debug)]
pub(crate) struct Kernel<B> {
    pub def: KernelDef,
    bindings: PhantomData<fn() -> B>,
}

impl<B> Kernel<B> {
    pub const fn new(shader: &'static Shader, entry: &'static str, threads: Threads) -> Self {
        Self { def: KernelDef { shader, entry, threads }, bindings: PhantomData }
    }
}

/// Declares the bindings of a shader: the number, the WGSL variable and what it is (`uniform(T)`,
/// `dynamic(T)`, `read`, `read_write`). Makes a struct with one buffer a binding.
macro_rules! bindings {
    (
        $(#[$doc:meta])*
        pub(crate) struct $name:ident { $($number:literal $field:ident: $kind:ident $(($uniform:ty))?,)* }
    ) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        pub(crate) struct $name<'a> { $(pub $field: &'a wgpu::Buffer,)* }

        impl $name<'_> {
            /// Its bindings.
            pub const fn layout() -> &'static $crate::kernel::BindingLayout {
                static LAYOUT: $crate::kernel::BindingLayout = $crate::kernel::BindingLayout {
                    name: stringify!($name),
                    bindings: &[$($crate::kernel::Binding {
                        number: $number,
                        name: stringify!($field),
                        kind: $crate::kernel::binding_kind!($kind $(($uniform))?),
                    },)*],
                };
                &LAYOUT
            }

            /// A bind group of these buffers, for kernels on a batch of `strands`.
            pub fn bind(
                &self,
                gpu: &$crate::Gpu,
                strands: $crate::kernel::StrandThreads,
            ) -> $crate::kernel::Bound<$name<'static>> {
                $crate::kernel::Bound::new(gpu, Self::layout(), &[$(self.$field,)*], strands)
            }
        }
    };
}
pub(crate) use bindings;

macro_rules! binding_kind {
    (uniform($uniform:ty)) => {
        $crate::kernel::BindingKind::Uniform(size_of::<$uniform>())
    };
    (dynamic($uniform:ty)) => {
        $crate::kernel::BindingKind::DynamicUniform(size_of::<$uniform>())
    };
    (read) => {
        $crate::kernel::BindingKind::Read
    };
    (read_write) => {
        $crate::kernel::BindingKind::ReadWrite
    };
}
pub(crate) use binding_kind;

/// Declares a shader and its kernels.
macro_rules! shader {
    (
        $(#[$doc:meta])*
        $shader:ident: $stage:literal, $bindings:ident;
        texts: [$($text:expr),* $(,)?];
        constants: [$($constants:expr),* $(,)?];
        kernels: { $($(#[$kernel_doc:meta])* $kernel:ident: $entry:literal, $threads:expr;)* }
    ) => {
        $(#[$doc])*
        pub(crate) static $shader: $crate::kernel::Shader = $crate::kernel::Shader {
            stage: $stage,
            texts: &[$($text),*],
            constants: &[$($constants),*],
            layout: $bindings::layout(),
            kernels: &[$(&$kernel.def),*],
        };
        $(
            $(#[$kernel_doc])*
            pub(crate) static $kernel: $crate::kernel::Kernel<$bindings<'static>> =
                $crate::kernel::Kernel::new(&$shader, $entry, $threads);
        )*
    };
}
pub(crate) use shader;

/// The threads that the strands of a batch take.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct StrandThreads {
    /// Workgroups of all strands.
    pub workgroups: u32,
    /// Particles of the longest strand.
    pub longest: u32,
}

/// A bind group whose buffers are those of `B`.
#[derive(Debug)]
pub(crate) struct Bound<B> {
    group: wgpu::BindGroup,
    /// Bytes between the elements of each dynamic uniform.
    strides: [u32; MAX_DYNAMIC],
    dynamic: usize,
    strands: StrandThreads,
    bindings: PhantomData<fn() -> B>,
}

impl<B> Bound<B> {
    /// Binds `buffers`, in the order of `layout`.
    pub fn new(
        gpu: &Gpu,
        layout: &'static BindingLayout,
        buffers: &[&wgpu::Buffer],
        strands: StrandThreads,
    ) -> Self {
        let (mut strides, mut dynamic) = ([0; MAX_DYNAMIC], 0);
        let mut entries = Vec::with_capacity(buffers.len());
        for (binding, &buffer) in layout.bindings.iter().zip(buffers) {
            let mut size = None;
            if let BindingKind::DynamicUniform(bytes) = binding.kind {
                strides[dynamic] = gpu.uniform_stride(bytes);
                dynamic += 1;
                size = std::num::NonZeroU64::new(bytes as u64);
            }
            let resource = wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset: 0, size });
            entries.push(wgpu::BindGroupEntry { binding: binding.number, resource });
        }
        let group = gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(layout.name),
            layout: &gpu.pipelines().layout(gpu.device(), layout),
            entries: &entries,
        });
        Self { group, strides, dynamic, strands, bindings: PhantomData }
    }

    /// A dispatch of `kernel`, with the element `elements[k]` of the `k`-th dynamic uniform; the
    /// rest take their first.
    pub fn dispatch(&self, kernel: &'static Kernel<B>, elements: &[u32]) -> Dispatch<'_> {
        let mut offsets = [0; MAX_DYNAMIC];
        for ((offset, stride), element) in offsets.iter_mut().zip(self.strides).zip(elements) {
            *offset = stride * element;
        }
        let workgroups = kernel.def.threads.workgroups(self.strands);
        Dispatch { kernel: &kernel.def, group: &self.group, offsets, dynamic: self.dynamic, workgroups }
    }
}

/// A kernel with its bind group and its size.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Dispatch<'a> {
    kernel: &'static KernelDef,
    group: &'a wgpu::BindGroup,
    offsets: [u32; MAX_DYNAMIC],
    dynamic: usize,
    workgroups: [u32; 2],
}

impl Dispatch<'_> {
    /// The stage of the kernel.
    pub fn stage(&self) -> &'static str {
        self.kernel.shader.stage
    }

    /// Records it. The first use of a kernel on a device makes its pipeline.
    pub fn record(&self, gpu: &Gpu, pass: &mut wgpu::ComputePass<'_>) {
        pass.set_pipeline(&gpu.pipelines().pipeline(gpu.device(), self.kernel));
        pass.set_bind_group(0, self.group, &self.offsets[..self.dynamic]);
        let [x, y] = self.workgroups;
        pass.dispatch_workgroups(x, y, 1);
    }
}

/// Dispatches in their order.
#[derive(Debug, Default)]
pub(crate) struct DispatchList<'a>(Vec<Dispatch<'a>>);

impl<'a> DispatchList<'a> {
    /// Appends a dispatch.
    pub fn push(&mut self, dispatch: Dispatch<'a>) {
        self.0.push(dispatch);
    }

    /// Appends a kernel: on each of `batches` if its threads are strands, otherwise once.
    pub fn run<B>(&mut self, batches: &'a [Bound<B>], kernel: &'static Kernel<B>, elements: &[u32]) {
        let by_strand = !matches!(kernel.def.threads, Threads::Workgroups(_));
        let count = if by_strand { batches.len() } else { batches.len().min(1) };
        self.0.extend(batches[..count].iter().map(|batch| batch.dispatch(kernel, elements)));
    }

    /// Appends a dispatch, if there is one.
    pub fn extend(&mut self, dispatch: Option<Dispatch<'a>>) {
        self.0.extend(dispatch);
    }

    /// The dispatches, one run of the same stage after the other.
    pub fn stages(&self) -> impl Iterator<Item = &[Dispatch<'a>]> {
        self.0.chunk_by(|a, b| a.stage() == b.stage())
    }

    /// All dispatches.
    pub fn iter(&self) -> std::slice::Iter<'_, Dispatch<'a>> {
        self.0.iter()
    }
}
