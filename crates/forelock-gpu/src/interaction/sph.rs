//! Smoothed-particle hydrodynamics (SPH) between hair particles on the device.
//!
//! # Practice
//! Particles of all batches are inserted into one table of buckets, sorted by counting. A thread
//! has one particle and its list of neighbours; lists are sorted by distance and number, so no
//! result depends on the order of threads. The CPU measures the rest densities.
//!
//! Memory: 12 bytes per particle and a table of 16 to 32. The rest, 120 bytes per particle with 16
//! neighbours, lies in the scratch of the strands where that is large enough: with up to 16
//! neighbours, if the strands are one batch.
//!
//! # Limitations
//! One binding bounds the strands: 120 bytes per particle, 1.1 million particles where a device
//! binds 128 MiB. Densities are not reported.

use crate::batch::DeviceStrands;
use crate::collide::Solids;
use crate::interaction::table::{self, ROW_CELLS};
use crate::interaction::{GpuInteraction, InteractionFrame, Kind, boxed};
use crate::kernel::{Bound, Constant, DispatchList, StrandThreads, Threads, bindings, shader};
use crate::{Gpu, GpuError};
use bytemuck::{Pod, Zeroable};
use forelock_core::frame::{Exchange, Span};
use forelock_core::interaction::contact::TABLE_WGSL;
use forelock_core::interaction::sph::find_neighbours::{self, MOST_NEIGHBOURS};
use forelock_core::interaction::sph::push_particles;
use forelock_core::interaction::sph::{self, Sph, SphParams};
use forelock_core::lane::LANES;
use forelock_core::lane::Simd;
use wgpu::BufferUsages;

/// Numbers of a particle in `cloud` before its list of neighbours.
const LIST_NUMBERS: usize = 14;

const CONSTANTS: &[Constant] = &[
    Constant::u32("MOST_NEIGHBOURS", MOST_NEIGHBOURS as u32),
    // Ends a list of neighbours that is not full.
    Constant::u32("NO_SLOT", u32::MAX),
];

bindings! {
    /// From strands to SPH particles and back.
    pub(crate) struct SphStrandBindings {
        2 blocks: read,
        5 positions: read_write,
        6 velocities: read_write,
        27 table: read_write,
        32 fluid: uniform(FluidUniform),
        33 cloud: read_write,
        34 names: read,
    }
}

bindings! {
    /// SPH particles alone.
    pub(crate) struct SphBindings {
        27 table: read_write,
        32 fluid: uniform(FluidUniform),
        33 cloud: read_write,
        34 names: read,
    }
}

shader! {
    /// `find_neighbours`, strand by strand.
    INSERT: "find_neighbours", SphStrandBindings;
    texts: [sph::WGSL, find_neighbours::STRANDS_WGSL];
    constants: [];
    kernels: {
        /// Counts the particles of each bucket.
        COUNT_PARTICLES: "count_particles", Threads::Strands;
        /// Stores them.
        INSERT_PARTICLES: "insert_particles", Threads::Strands;
        /// Applies the accelerations to velocities.
        ACCELERATE_STRANDS: "accelerate_strands", Threads::Strands;
    }
}

shader! {
    /// `find_neighbours`, over all particles.
    FIND: "find_neighbours", SphBindings;
    texts: [sph::WGSL, TABLE_WGSL, find_neighbours::WGSL];
    constants: [CONSTANTS, table::CONSTANTS];
    kernels: {
        /// Clears the buckets.
        CLEAR_BUCKETS: "clear_buckets", Threads::LIST;
        /// Turns the counts of buckets into their first particles.
        SCAN_BUCKETS: "scan_buckets", table::ROWS;
        /// Finds the neighbours and the density of each particle.
        FIND_NEIGHBOURS: "find_neighbours", Threads::LIST;
    }
}

shader! {
    /// `push_particles`.
    PUSH: "push_particles", SphBindings;
    texts: [sph::WGSL, push_particles::WGSL];
    constants: [CONSTANTS];
    kernels: {
        /// Accelerations by pressure and viscosity.
        PUSH_PARTICLES: "push_particles", Threads::LIST;
    }
}

/// Registers SPH.
pub(crate) static KIND: Kind = Kind {
    name: sph::EXCHANGE.name,
    shaders: &[&INSERT, &FIND, &PUSH],
    make: |gpu, strands, all| boxed(all.sph.as_ref().map(|params| DeviceSph::new(gpu, strands, params))),
};

/// The fluid: `Fluid` in the kernels, where its fields are documented.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[expect(missing_docs, reason = "documented in WGSL")]
pub struct FluidUniform {
    pub h: f32,
    pub h2: f32,
    pub inverse_h: f32,
    pub dt: f32,
    pub mass_density: f32,
    pub mass_push: f32,
    pub mass_drag: f32,
    pub pressure: f32,
    pub viscosity: f32,
    pub inverse_dt: f32,
    pub neighbours: u32,
    pub numbers: u32,
    pub buckets: u32,
    pub own_strand: u32,
    pub mutual: u32,
    pub pad_0: u32,
}

/// The SPH particles of a simulation.
#[derive(Debug)]
struct DeviceSph {
    params: SphParams,
    uniform: wgpu::Buffer,
    cloud: wgpu::Buffer,
    names: wgpu::Buffer,
    table: wgpu::Buffer,
    groups: SphGroups,
    /// Bytes of the buffers that it owns.
    bytes: u64,
    host: FluidUniform,
}

#[derive(Debug, Default)]
struct SphGroups {
    strands: Vec<Bound<SphStrandBindings<'static>>>,
    particles: Vec<Bound<SphBindings<'static>>>,
}

impl DeviceSph {
    /// The particles of `strands`, to be bound before the first frame.
    fn new(gpu: &Gpu, strands: DeviceStrands<'_>, params: &SphParams) -> Result<Self, GpuError> {
        params.validate()?;
        let DeviceStrands { model, shared, .. } = strands;
        let sph = Sph::new(model, params, Simd::Auto);
        let (fluid, [mass_density, mass_push, mass_drag]) = (sph.fluid(), sph.fluid().masses());
        let numbers = LANES * model.places();
        let buckets = (2 * model.particle_count).next_power_of_two().clamp(ROW_CELLS as usize, 1 << 22);
        let cloud = 4 * (numbers * (LIST_NUMBERS + fluid.neighbours)) as u64;
        let what = "smoothed particles of so many strands, or with so many neighbours,";
        gpu.check_room(what, cloud.max(12 * numbers as u64), u64::MAX)?;
        let mut names = vec![[0u32; 3]; numbers];
        for block in &model.blocks {
            for (lane, &strand) in block.strands.iter().enumerate() {
                for (number, place) in (model.offsets[strand as usize]..).zip(block.range()) {
                    let rest = sph.rest_density()[number as usize];
                    names[place * LANES + lane] = [number, strand, rest.to_bits()];
                }
            }
        }
        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        let names = gpu.filled("names", bytemuck::cast_slice(&names), storage);
        let table = gpu.buffer("table", 4 * (2 * buckets as u64 + 1), storage);
        let mut bytes = names.size() + table.size();
        let cloud = if shared.scratch.size() >= cloud {
            shared.scratch.clone()
        } else {
            bytes += cloud;
            gpu.buffer("cloud", cloud, storage)
        };
        let uniform = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let uniform = gpu.buffer("fluid", size_of::<FluidUniform>() as u64, uniform);
        bytes += uniform.size();
        let host = FluidUniform {
            h: fluid.h,
            h2: fluid.h2,
            inverse_h: 1.0 / fluid.h,
            mass_density,
            mass_push,
            mass_drag,
            pressure: fluid.pressure,
            viscosity: fluid.viscosity,
            neighbours: fluid.neighbours as u32,
            numbers: numbers as u32,
            buckets: buckets as u32,
            own_strand: fluid.own_strand.into(),
            mutual: fluid.mutual.into(),
            ..FluidUniform::zeroed()
        };
        let (params, groups) = (params.clone(), SphGroups::default());
        Ok(Self { params, uniform, cloud, names, table, groups, bytes, host })
    }
}

impl GpuInteraction for DeviceSph {
    fn exchange_plan(&self) -> Exchange {
        sph::EXCHANGE
    }

    fn bind(&mut self, gpu: &Gpu, strands: DeviceStrands<'_>, _: &Solids) {
        let mut groups = SphGroups::default();
        for batch in strands.batches {
            let bindings = SphStrandBindings {
                blocks: &batch.blocks,
                positions: &batch.positions,
                velocities: &batch.velocities,
                table: &self.table,
                fluid: &self.uniform,
                cloud: &self.cloud,
                names: &self.names,
            };
            groups.strands.push(bindings.bind(gpu, batch.threads));
        }
        let bindings =
            SphBindings { table: &self.table, fluid: &self.uniform, cloud: &self.cloud, names: &self.names };
        groups.particles.push(bindings.bind(gpu, StrandThreads::default()));
        self.groups = groups;
    }

    fn write_frame(&mut self, gpu: &Gpu, frame: &InteractionFrame<'_>) {
        let dt_secs = frame.input.dt_secs;
        (self.host.dt, self.host.inverse_dt) = (dt_secs as f32, (1.0 / dt_secs) as f32);
        gpu.queue().write_buffer(&self.uniform, 0, bytemuck::bytes_of(&self.host));
    }

    fn exchange<'a>(&'a self, list: &mut DispatchList<'a>, _: Span) {
        let SphGroups { strands, particles } = &self.groups;
        list.run(particles, &CLEAR_BUCKETS, &[]);
        list.run(strands, &COUNT_PARTICLES, &[]);
        list.run(particles, &SCAN_BUCKETS, &[]);
        list.run(strands, &INSERT_PARTICLES, &[]);
        list.run(particles, &FIND_NEIGHBOURS, &[]);
        list.run(particles, &PUSH_PARTICLES, &[]);
        list.run(strands, &ACCELERATE_STRANDS, &[]);
    }

    fn rebuild(&self, gpu: &Gpu, strands: DeviceStrands<'_>) -> Result<Box<dyn GpuInteraction>, GpuError> {
        Ok(Box::new(Self::new(gpu, strands, &self.params)?))
    }

    fn bytes(&self) -> u64 {
        self.bytes
    }
}
