//! The fields of bodies that bend, on the device.
//!
//! # Practice
//! What does not change with the pose is uploaded once. The field of a pose takes one of two slots:
//! in a step from where the last one ended only the pose at its end is uploaded, and nothing while
//! the body holds still. Bricks that the body at rest has are in neither, since fields of all poses
//! share them.

use crate::Gpu;
use crate::collide::SolidEntry;
use forelock_core::body::{BRICK_NODES, BendingBody, BendingField, BendingLevel, ColliderFrame, Shape};
use glam::{DVec2, UVec4, Vec3};

/// A body that bends, in the buffer of fields.
#[derive(Debug)]
pub(crate) struct DeviceBody {
    body: BendingBody,
    /// Its first number in the buffer.
    first: usize,
    counts: Counts,
    /// The corners of the poses in the slots, of which the fields are there.
    slots: [Vec<Vec3>; 2],
    /// The slots of the step's start and of its end.
    ends: [usize; 2],
    /// Whether all cells are there as the same at both ends.
    is_still: bool,
    /// Numbers to be uploaded.
    numbers: Vec<f32>,
}

/// How many there are of what a body has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Counts {
    nodes: usize,
    cells: usize,
    corners: usize,
    triangles: usize,
    /// Bricks of the body at rest.
    at_rest: usize,
    /// Room for others, a slot.
    room: usize,
}

/// Where a body's arrays are, as shaders need it: the first node at both ends of a step, and `body`
/// of a solid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct BodyPlace {
    /// The first node at the step's start and at its end.
    pub nodes: [u32; 2],
    /// Corners of triangles, falls of cells, values of bricks, nearest triangles.
    pub body: UVec4,
}

impl Counts {
    fn of(field: &BendingField, body: &BendingBody, room: usize) -> Self {
        let level = field.level(1);
        Self {
            nodes: level.nodes.len(),
            cells: field.falls().len(),
            corners: level.corners.len(),
            triangles: body.triangles().len(),
            at_rest: body.bricks().len() / BRICK_NODES,
            room,
        }
    }

    /// Numbers of a slot: nodes, table of bricks, corners.
    fn slot(&self) -> usize {
        2 * self.nodes + 3 * self.corners
    }

    fn bricks(&self) -> usize {
        self.at_rest + 2 * self.room
    }

    /// The place of the triangles' corners; then of the slots, of falls, of bricks, of the nearest
    /// triangles, and the end.
    fn places(&self) -> [usize; 6] {
        let sizes = [
            3 * self.triangles,
            2 * self.slot(),
            self.cells,
            self.bricks() * BRICK_NODES,
            self.bricks() * BRICK_NODES,
        ];
        let mut places = [0; 6];
        for (k, size) in sizes.into_iter().enumerate() {
            places[k + 1] = places[k] + size;
        }
        places
    }
}

impl DeviceBody {
    /// The body of `field`, to be placed at number `first` of a buffer, with room for twice as many
    /// bricks as it has beside those at rest.
    pub fn new(field: &BendingField, first: usize) -> Self {
        let body = field.body();
        let bricks = [0, 1].map(|end| field.level(end).bricks.len() / BRICK_NODES);
        let most = bricks[0].max(bricks[1]);
        let counts = Counts::of(field, &body, 2 * most + body.bricks().len() / BRICK_NODES / 8 + 64);
        let slots = [Vec::new(), Vec::new()];
        Self { body, first, counts, slots, ends: [0, 1], is_still: false, numbers: Vec::new() }
    }

    /// Numbers that it takes.
    pub fn len(&self) -> usize {
        self.counts.places()[5]
    }

    /// Whether `field` is one of this body, and has room here.
    pub fn fits(&self, field: &BendingField) -> bool {
        let room = self.counts.room * BRICK_NODES;
        self.body.is_of(field) && [0, 1].iter().all(|&end| field.level(end).bricks.len() <= room)
    }

    /// Uploads what does not change.
    pub fn write_rest(&mut self, gpu: &Gpu, buffer: &wgpu::Buffer) {
        let [triangles, _, _, bricks, nearest, _] = self.counts.places();
        let corners = self.body.triangles().flatten().map(|corner| corner as f32);
        write(gpu, buffer, self.first + triangles, &mut self.numbers, corners);
        gpu.queue().write_buffer(
            buffer,
            bytes(self.first + bricks),
            bytemuck::cast_slice(self.body.bricks()),
        );
        let of_bricks = self.body.nearest().iter().map(|&own| triangle_number(own));
        write(gpu, buffer, self.first + nearest, &mut self.numbers, of_bricks);
    }

    /// Uploads what is missing of `field`, which fits.
    pub fn write(&mut self, gpu: &Gpu, buffer: &wgpu::Buffer, field: &BendingField) {
        let levels = [0, 1].map(|end| field.level(end));
        let held = levels.map(|level| self.slots.iter().position(|corners| corners == level.corners));
        self.ends = match held {
            _ if levels[0].corners == levels[1].corners => [held[0].unwrap_or(0); 2],
            [Some(start), _] => [start, 1 - start],
            [None, Some(end)] => [1 - end, end],
            [None, None] => [0, 1],
        };
        for (slot, level) in self.ends.into_iter().zip(levels) {
            if self.slots[slot] != level.corners {
                self.write_level(gpu, buffer, slot, &level);
            }
        }
        if field.changes() || !self.is_still {
            let place = self.first + self.counts.places()[2];
            gpu.queue().write_buffer(buffer, bytes(place), bytemuck::cast_slice(field.falls()));
            self.is_still = !field.changes();
        }
    }

    fn write_level(&mut self, gpu: &Gpu, buffer: &wgpu::Buffer, slot: usize, level: &BendingLevel<'_>) {
        let Counts { at_rest, room, nodes, .. } = self.counts;
        let [_, slots, _, bricks, nearest, _] = self.counts.places();
        let first = self.first + slots + slot * self.counts.slot();
        gpu.queue().write_buffer(buffer, bytes(first), bytemuck::cast_slice(level.nodes));
        // Bricks of its own follow those of the slot before.
        let after = at_rest as u32;
        let own = |number: u32| if number > after { number + (slot * room) as u32 } else { number };
        let table = level.brick_numbers().map(|number| own(number) as f32);
        let corners = level.corners.iter().flat_map(Vec3::to_array);
        write(gpu, buffer, first + nodes, &mut self.numbers, table.chain(corners));
        let within = (at_rest + slot * room) * BRICK_NODES;
        let place = self.first + bricks + within;
        gpu.queue().write_buffer(buffer, bytes(place), bytemuck::cast_slice(level.bricks));
        let of_bricks = level.nearest.iter().map(|&own| triangle_number(own));
        write(gpu, buffer, self.first + nearest + within, &mut self.numbers, of_bricks);
        self.slots[slot].clear();
        self.slots[slot].extend_from_slice(level.corners);
    }

    /// Where its arrays are.
    pub fn place(&self) -> BodyPlace {
        let [triangles, slots, falls, bricks, nearest, _] =
            self.counts.places().map(|place| self.first + place);
        BodyPlace {
            nodes: self.ends.map(|slot| (slots + slot * self.counts.slot()) as u32),
            body: UVec4::new(triangles as u32, falls as u32, bricks as u32, nearest as u32),
        }
    }
}

/// The fields of those of `solids` that bend.
pub(crate) fn bending<'a>(solids: &'a [ColliderFrame<'_>]) -> impl Iterator<Item = &'a BendingField> {
    solids.iter().filter_map(|solid| match solid.shape {
        Shape::Bending(field) => Some(&**field),
        _ => None,
    })
}

impl SolidEntry {
    /// Says where `body` is, whose `field` it is between two `fractions` of a frame.
    pub(crate) fn place_body(&mut self, field: &BendingField, body: &DeviceBody, fractions: [f64; 2]) {
        let place = body.place();
        [self.first, self.described] = place.nodes;
        (self.body, self.phases) = (place.body, DVec2::from_array(fractions).as_vec2());
        (self.origin, self.dims) = (field.end().origin(), field.end().dims());
    }
}

/// The number of a triangle as a float, which holds it exactly; below 0 for none.
fn triangle_number(triangle: u32) -> f32 {
    if triangle == u32::MAX { -1.0 } else { triangle as f32 }
}

fn bytes(numbers: usize) -> u64 {
    (numbers * size_of::<f32>()) as u64
}

/// Uploads `values` to the numbers from `place` on.
fn write(
    gpu: &Gpu,
    buffer: &wgpu::Buffer,
    place: usize,
    numbers: &mut Vec<f32>,
    values: impl Iterator<Item = f32>,
) {
    numbers.clear();
    numbers.extend(values);
    gpu.queue().write_buffer(buffer, bytes(place), bytemuck::cast_slice(numbers));
}
