//! The rest shape, drawn into the picture of the hair.

use forelock::player::Moment;

use crate::lines::Lines;

/// The most strands that are drawn.
const STRANDS: usize = 1500;
/// Their colour, linear RGB.
const COLOUR: [f32; 3] = [0.05, 0.5, 0.75];

/// Evenly chosen strands of the rest shape of `moment`, where the head is.
pub fn rest_shape(moment: &Moment) -> Lines {
    let groom = moment.groom();
    let every = groom.strand_count().div_ceil(STRANDS).max(1);
    let mut lines = Lines::default();
    for strand in groom.strands().step_by(every) {
        lines.add(strand.iter().map(|x| moment.head.transform_point(x.as_dvec3()).as_vec3()), COLOUR);
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use forelock::scene::Override;
    use forelock::{Backend, Player, Scene};
    use forelock_core::pose::Pose;
    use glam::{DQuat, DVec3};

    #[test]
    fn it_is_the_rest_shape_where_the_head_is() -> Result<(), Box<dyn std::error::Error>> {
        let sets = ["groom.strands=2000", "groom.vertices_per_strand=5", "body.sdf_cells=32"];
        let sets = sets.into_iter().map(Override::set).collect::<Result<Vec<_>, _>>()?;
        let mut player = Player::builder(Scene::builtin(&sets)?).backend(Backend::Cpu).build()?;
        let pose = Pose::new(DQuat::from_rotation_y(0.3), DVec3::new(0.1, 0.0, 0.0));
        player.set_head_pose(pose)?;
        player.step()?;
        let moment = player.moment()?;
        let ghost = rest_shape(&moment);
        assert_eq!(ghost.offsets.len(), 1001);
        let rest = moment.groom().positions();
        // Every second strand of five particles.
        for (k, at) in ghost.positions.iter().enumerate() {
            let own = rest[k / 5 * 10 + k % 5].as_dvec3();
            assert!(at.distance(pose.transform_point(own).as_vec3()) < 1e-6, "{k}");
        }
        // Roots are where those of the hair are, and tips are not.
        assert!(ghost.positions[0].distance(moment.positions[0]) < 1e-5);
        assert!(ghost.positions[4].distance(moment.positions[4]) > 1e-3);
        Ok(())
    }
}
