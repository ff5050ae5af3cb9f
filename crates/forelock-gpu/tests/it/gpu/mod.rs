//! Kernels on a device, compared with the same stages on the CPU. All tests share one device.

mod air;
mod bending;
mod clock;
mod conformance;
mod contacts;
mod follow;
mod goldens;
mod grid;
mod guides;
mod limits;
mod masses;
mod pipelines;
mod rod_constraints;
mod rods;
mod roots;
mod simulator;
mod skin;
mod skin_roots;
mod sleep;
mod strays;
mod thin;
