//! The picture of the hair in the window, and what the mouse does in it.

use std::sync::{Arc, Mutex, PoisonError};

use eframe::egui;
use forelock::player::{ColliderId, Moment};
use forelock::scene::{ColliderSection, ShapeKind};
use forelock::session::Session;
use forelock_core::pose::Pose;
use glam::{DQuat, DVec3, Vec2, Vec3};

use crate::orbit::Orbit;
use crate::tools::{Brush, BrushSize, Picked, Tool, pick};

/// Pixels around the pointer in which hair is picked.
const REACH: f32 = 12.0;
/// Pixels for a notch of a wheel.
const NOTCH: f32 = 50.0;
/// Size of a solid that pushes, metres.
const PUSHER: f64 = 0.035;

/// A drag with the main button.
#[derive(Clone, Debug)]
enum Drag {
    Look,
    /// The head follows from its pose at the start; the pointer's place then, and its depth.
    Head {
        from: Pose,
        pointer: Vec2,
        depth: f32,
        turns: bool,
    },
    /// The solid follows at a depth.
    Push {
        depth: f32,
    },
    /// Particles under the stroke so far.
    Stroke {
        brush: Brush,
        picked: Vec<usize>,
        points: Vec<egui::Pos2>,
    },
}

/// A solid that the mouse moves; its identity comes from the session's thread.
#[derive(Clone, Debug)]
struct Pusher {
    shape: ShapeKind,
    id: Arc<Mutex<Option<ColliderId>>>,
}

/// The picture and its mouse.
#[derive(Debug)]
pub struct Viewport {
    /// The camera.
    pub orbit: Orbit,
    /// What a drag does, unless it only looks.
    pub tool: Tool,
    /// Whether drags move the camera alone, because there is nothing to change.
    pub only_looks: bool,
    /// Size and strength of brushes.
    pub brush: BrushSize,
    drag: Option<Drag>,
    pusher: Option<Pusher>,
    /// Whether the drag has moved the head or a solid.
    has_moved: bool,
}

/// What the mouse did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Done {
    /// The hair was edited, or the head or a solid moved.
    pub changed: bool,
}

impl Viewport {
    /// A picture from `orbit`.
    pub fn new(orbit: Orbit) -> Self {
        let (tool, brush) = (Tool::Head, BrushSize::default());
        Self { orbit, tool, only_looks: false, brush, drag: None, pusher: None, has_moved: false }
    }

    /// What a drag does.
    pub fn tool(&self) -> Tool {
        if self.only_looks { Tool::Look } else { self.tool }
    }

    /// Forgets all that belongs to another session.
    pub fn forget(&mut self) {
        (self.drag, self.pusher, self.has_moved) = (None, None, false);
    }

    /// Whether there is a solid that pushes.
    pub fn has_pusher(&self) -> bool {
        self.pusher.is_some()
    }

    /// Takes the solid that pushes away.
    pub fn remove_pusher(&mut self, session: &Session) {
        if let Some(Pusher { id, .. }) = self.pusher.take() {
            session.change("removing the solid", move |player| match *lock(&id) {
                Some(id) => player.remove_collider(id),
                None => Ok(()),
            });
        }
    }

    /// What the mouse does in the picture at `response`, whose pixels are `scale` to a point.
    pub fn interact(
        &mut self,
        ui: &egui::Ui,
        response: &egui::Response,
        scale: f32,
        session: &Session,
        moment: &Arc<Moment>,
    ) -> Done {
        let rect = response.rect;
        let size = [rect.width(), rect.height()].map(|side| ((side * scale) as u32).max(1));
        let pixel = |pos: egui::Pos2| Vec2::new(pos.x - rect.left(), pos.y - rect.top()) * scale;
        let delta = response.drag_delta() * scale;
        let delta = Vec2::new(delta.x, delta.y);
        let (shift, scroll, zoom) =
            ui.input(|input| (input.modifiers.shift, input.smooth_scroll_delta().y, input.zoom_delta()));
        if response.dragged_by(egui::PointerButton::Middle) {
            if shift {
                self.orbit.pan(delta, size[0], size[1]);
            } else {
                self.orbit.turn(delta);
            }
        }
        if response.dragged_by(egui::PointerButton::Secondary) {
            self.orbit.pan(delta, size[0], size[1]);
        }
        if response.hovered() {
            self.orbit.zoom(scroll / NOTCH + 10.0 * (zoom - 1.0));
        }
        let mut done = Done::default();
        let pointer = response.interact_pointer_pos();
        if let Some(pos) = pointer {
            let is_down =
                response.is_pointer_button_down_on() && ui.input(|input| input.pointer.primary_down());
            if is_down && self.drag.is_none() {
                self.drag = Some(self.begin(pixel(pos), size, shift, session, moment));
            }
            self.follow(pos, pixel(pos), delta, size, session, moment);
        }
        if self.drag.is_some() && !ui.input(|input| input.pointer.primary_down()) {
            done = self.end(session, moment);
        }
        done
    }

    fn begin(
        &mut self,
        pixel: Vec2,
        size: [u32; 2],
        turns: bool,
        session: &Session,
        moment: &Moment,
    ) -> Drag {
        let camera = self.orbit.camera();
        let picked = pick(moment, &camera, size, pixel, REACH);
        let depth = picked.map_or(self.orbit.distance, |picked| picked.depth);
        match self.tool() {
            Tool::Look => Drag::Look,
            Tool::Head => {
                session.play(true);
                Drag::Head { from: moment.head, pointer: pixel, depth: self.orbit.distance, turns }
            }
            Tool::Push(shape) => {
                let at = camera.unproject(pixel, depth, size[0], size[1]);
                self.place_pusher(shape, at, session);
                self.has_moved = true;
                session.play(true);
                Drag::Push { depth }
            }
            Tool::Brush(brush) => Drag::Stroke { brush, picked: Vec::new(), points: Vec::new() },
        }
    }

    fn follow(
        &mut self,
        pos: egui::Pos2,
        pixel: Vec2,
        delta: Vec2,
        size: [u32; 2],
        session: &Session,
        moment: &Moment,
    ) {
        let camera = self.orbit.camera();
        match &mut self.drag {
            None => {}
            Some(Drag::Look) => self.orbit.turn(delta),
            Some(Drag::Head { from, pointer, depth, turns }) => {
                let moved = pixel - *pointer;
                if delta == Vec2::ZERO {
                    return;
                }
                let pose = if *turns {
                    turned(from, moved, &self.orbit, middle(moment))
                } else {
                    let by = self.orbit.shift(moved, *depth, size[0], size[1]);
                    Pose::new(from.rotation, from.translation + by.as_dvec3())
                };
                self.has_moved = true;
                session.change("the head", move |player| player.set_head_pose(pose));
            }
            Some(Drag::Push { depth }) => {
                let at = camera.unproject(pixel, *depth, size[0], size[1]).as_dvec3();
                if let Some(Pusher { id, .. }) = &self.pusher {
                    let id = id.clone();
                    session.change("moving the solid", move |player| match *lock(&id) {
                        Some(id) => player.set_collider_pose(id, Pose::new(DQuat::IDENTITY, at)),
                        None => Ok(()),
                    });
                }
            }
            Some(Drag::Stroke { picked, points, .. }) => {
                let is_further = points.last().is_none_or(|last| last.distance(pos) > 2.0);
                let hit: Option<Picked> =
                    if is_further { pick(moment, &camera, size, pixel, REACH) } else { None };
                points.extend(is_further.then_some(pos));
                picked.extend(hit.map(|hit| hit.particle));
            }
        }
    }

    fn end(&mut self, session: &Session, moment: &Moment) -> Done {
        let changed = std::mem::take(&mut self.has_moved);
        let Some(Drag::Stroke { brush, picked, .. }) = self.drag.take() else { return Done { changed } };
        let Some(edit) = brush.edit(self.brush, moment, &picked) else { return Done::default() };
        session.change("the edit", move |player| player.edit_selected(edit));
        Done { changed: true }
    }

    /// Puts a solid of `shape` to `at`.
    fn place_pusher(&mut self, shape: ShapeKind, at: Vec3, session: &Session) {
        if self.pusher.as_ref().is_some_and(|pusher| pusher.shape != shape) {
            self.remove_pusher(session);
        }
        if self.pusher.is_none() {
            let pusher = Pusher { shape, id: Arc::default() };
            let (id, radius) = (pusher.id.clone(), (shape == ShapeKind::Sphere).then_some(PUSHER));
            let position = at.as_dvec3().to_array();
            let section = ColliderSection { shape, radius, position, ..ColliderSection::default() };
            session.change("adding the solid", move |player| {
                *lock(&id) = Some(player.add_collider(&section)?);
                Ok(())
            });
            self.pusher = Some(pusher);
        }
    }

    /// The brush around the pointer, and the stroke so far.
    pub fn paint(&self, ui: &egui::Ui, response: &egui::Response) {
        let painter = ui.painter_at(response.rect);
        let stroke = egui::Stroke::new(1.5, egui::Color32::from_rgb(255, 200, 90));
        if let Some(Drag::Stroke { points, .. }) = &self.drag {
            painter.add(egui::Shape::line(points.clone(), stroke));
        }
        if let (Tool::Brush(brush), Some(pos)) = (self.tool(), response.hover_pos())
            && brush.has_radius()
        {
            let point_metres = 2.0 * self.orbit.distance * (0.5 * self.orbit.camera().fov_y).tan()
                / response.rect.width().min(response.rect.height()).max(1.0);
            painter.circle_stroke(pos, self.brush.radius / point_metres, stroke);
        }
    }
}

/// The middle of the body, or else of the hair, world space.
fn middle(moment: &Moment) -> DVec3 {
    let points = moment.body().map_or(&moment.positions[..], |mesh| &mesh.positions);
    let sum: DVec3 = points.iter().map(|x| x.as_dvec3()).sum();
    let own = sum / (points.len().max(1) as f64);
    if moment.body().is_some() { moment.head.transform_point(own) } else { own }
}

/// `from` turned about `middle` by a drag of `pixels`: around y, and around the camera's right.
fn turned(from: &Pose, pixels: Vec2, orbit: &Orbit, middle: DVec3) -> Pose {
    let right = DVec3::new(f64::from(orbit.yaw.cos()), 0.0, -f64::from(orbit.yaw.sin()));
    let [yaw, pitch] = [pixels.x, pixels.y].map(|own| f64::from(own) * 0.01);
    let turn = DQuat::from_axis_angle(DVec3::Y, yaw) * DQuat::from_axis_angle(right, pitch);
    let about = Pose::new(turn, middle - turn * middle);
    about.after(from)
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
