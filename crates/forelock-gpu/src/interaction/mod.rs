//! The GPU kernels of each interaction between strands. An interaction is registered by one line in
//! `KINDS`.

pub mod contact;
pub mod grid;
pub mod sph;
pub(crate) mod table;

use crate::batch::DeviceStrands;
use crate::collide::Solids;
use crate::kernel::{DispatchList, Shader};
use crate::report::GpuReport;
use crate::uniforms::ReportEntry;
use crate::{Gpu, GpuError};
use forelock_core::frame::{Exchange, FrameInput, Span};
use forelock_core::interaction::Interactions;
use forelock_core::pose::Pose;
use glam::DVec3;
use std::fmt::Debug;

/// The kinds of interactions, in the order in which a simulation holds them.
pub(crate) static KINDS: [&Kind; 3] = [&grid::KIND, &sph::KIND, &contact::KIND];

/// A kind of interaction.
#[derive(Debug)]
pub(crate) struct Kind {
    /// The name in its [`Exchange`].
    pub name: &'static str,
    /// Its shaders.
    pub shaders: &'static [&'static Shader],
    /// Builds it for strands, if the parameters contain it.
    pub make: fn(&Gpu, DeviceStrands<'_>, &Interactions) -> Made,
}

/// A new interaction, if it was wanted.
pub(crate) type Made = Result<Option<Box<dyn GpuInteraction>>, GpuError>;

/// `own` as a simulation holds it.
fn boxed<I: GpuInteraction + 'static>(own: Option<Result<I, GpuError>>) -> Made {
    Ok(own.transpose()?.map(|own| Box::new(own) as Box<dyn GpuInteraction>))
}

/// An interaction on a GPU.
pub(crate) trait GpuInteraction: Debug + Send + Sync {
    /// Its name, when it runs, and what it moves.
    fn exchange_plan(&self) -> Exchange;

    /// Creates its bind groups. It is called again whenever a buffer was replaced.
    fn bind(&mut self, gpu: &Gpu, strands: DeviceStrands<'_>, solids: &Solids);

    /// Writes its uniforms of a frame.
    fn write_frame(&mut self, gpu: &Gpu, frame: &InteractionFrame<'_>);

    /// Appends the dispatches that record where hair is at the start of `span`, if
    /// [`Exchange::records_start`].
    fn record_start<'a>(&'a self, list: &mut DispatchList<'a>, span: Span) {
        let _ = (list, span);
    }

    /// Appends the dispatches that exchange momentum after `span`.
    fn exchange<'a>(&'a self, list: &mut DispatchList<'a>, span: Span);

    /// An exchange that comes earlier in the frame, if it has one; both have the same name.
    fn early_exchange(&self) -> Option<Exchange> {
        None
    }

    /// Appends the dispatches of [`early_exchange`](Self::early_exchange).
    fn exchange_early<'a>(&'a self, list: &mut DispatchList<'a>, span: Span) {
        let _ = (list, span);
    }

    /// The buffer that a report reads back, if there is one.
    fn report_buffer(&self) -> Option<&wgpu::Buffer> {
        None
    }

    /// Adds to `report` what the `bytes` of [`Self::report_buffer`] contain; `shared` is the entry
    /// that all kernels report to.
    fn add_report(&self, bytes: &[u8], shared: &ReportEntry, report: &mut GpuReport) {
        let _ = (bytes, shared, report);
    }

    /// Seconds of still surroundings before which no strand falls asleep.
    fn settle_secs(&self) -> f64 {
        0.0
    }

    /// The same interaction for other strands.
    fn rebuild(&self, gpu: &Gpu, strands: DeviceStrands<'_>) -> Result<Box<dyn GpuInteraction>, GpuError>;

    /// Bytes held on the device.
    fn bytes(&self) -> u64;
}

/// What an interaction is given for one frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct InteractionFrame<'a> {
    /// The frame.
    pub input: &'a FrameInput<'a>,
    /// The head at the frame's start, from the model's centre to where positions are then.
    pub start: Pose,
    /// The head at the ends of the substeps, from the model's centre to `origin`, and before them
    /// that at the frame's start.
    pub poses: &'a [Pose],
    /// The point of the world that positions are relative to after strands are solved.
    pub origin: DVec3,
    /// Particles of each strand, from the root, that follow the head.
    pub clamped: u32,
    /// Substeps of the frame.
    pub substeps: u32,
    /// Spans of the frame, at whose ends interactions that repeat run.
    pub spans: &'a [Span],
    /// Seconds for which head, gravity, air and colliders have been still; 0 if that is not
    /// measured.
    pub calm_secs: f64,
}

/// Puts `made`, of the kind called `name`, in the place of the one of `all` with that name, or
/// removes that one. `all` keeps the order of [`KINDS`].
pub(crate) fn replace(
    all: &mut Vec<Box<dyn GpuInteraction>>,
    name: &str,
    made: Option<Box<dyn GpuInteraction>>,
) {
    all.retain(|own| own.exchange_plan().name != name);
    all.extend(made);
    all.sort_by_key(|own| KINDS.iter().position(|kind| kind.name == own.exchange_plan().name));
}
