//! Every kernel is valid, lays its structs out as the CPU does, and can be said in the languages of other devices.

#![expect(clippy::unwrap_used, reason = "in a test a failure to build is a failure of the test")]

use forelock_gpu::air::{AirUniform, CanopyEntry, ModeEntry};
use forelock_gpu::contacts::{MeetUniform, TouchEntry};
use forelock_gpu::grid::{BoundsEntry, GridSolidEntry, GridUniform};
use forelock_gpu::kernels::{Binding, GROUPS, Group, STAGES, Stage, StageKernels, text};
use forelock_gpu::layout::{BlockEntry, FrameUniform, ReportEntry, SubstepUniform};
use forelock_gpu::particles::FluidUniform;
use forelock_gpu::skinning::{CarriedEntry, SkinUniform};
use forelock_gpu::solids::{LookUniform, SolidEntry};
use naga::back::{hlsl, msl, spv};
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use std::mem::offset_of;

/// Each stage, for devices with subgroups and without.
fn modules() -> impl Iterator<Item = (&'static StageKernels, bool, naga::Module, ModuleInfo)> {
    let texts = STAGES.iter().flat_map(|stage| [false, true].map(|subgroups| (stage, subgroups)));
    texts.map(|(stage, subgroups)| {
        let text = text(stage, subgroups);
        let module = naga::front::wgsl::parse_str(&text)
            .unwrap_or_else(|error| panic!("{}: {}", stage.name, error.emit_to_string(&text)));
        // No capability beyond what every device of WebGPU has, and what is asked for; halves are packed on every one.
        let halves = (stage.stage == Stage::SolveHalved, Capabilities::SHADER_FLOAT16_IN_FLOAT32);
        let needed = [halves, (subgroups, Capabilities::SUBGROUP)];
        let needed = needed.into_iter().filter(|(is, _)| *is).map(|(_, capability)| capability);
        let mut validator = Validator::new(ValidationFlags::all(), needed.collect());
        validator.subgroup_stages(naga::valid::ShaderStages::COMPUTE);
        validator.subgroup_operations(naga::valid::SubgroupOperationSet::all());
        let info = validator.validate(&module).unwrap_or_else(|error| panic!("{}: {error:?}", stage.name));
        (stage, subgroups, module, info)
    })
}

#[test]
fn kernels_need_nothing_beyond_webgpu_and_have_the_entry_points_of_the_table() {
    for (stage, _, module, _) in modules() {
        let entries: Vec<_> = module.entry_points.iter().map(|entry| &*entry.name).collect();
        let mut named: Vec<_> = stage.kernels.iter().map(|(_, name, _)| *name).collect();
        named.sort_by_key(|name| entries.iter().position(|entry| entry == name));
        assert_eq!(entries, named);
    }
    // Pipelines are found by number.
    let kernels: Vec<_> = STAGES.iter().flat_map(|stage| stage.kernels).map(|(kernel, ..)| *kernel).collect();
    assert!(kernels.iter().enumerate().all(|(number, kernel)| *kernel as usize == number), "{kernels:?}");
    assert!(STAGES.iter().enumerate().all(|(number, stage)| stage.stage as usize == number));
    assert!(kernels.iter().all(|&own| own.stage().kernels.iter().any(|(kernel, ..)| *kernel == own)));
    assert!(GROUPS.iter().enumerate().all(|(number, group)| *group as usize == number));
}

/// Name and offset of a struct's fields, and its size, as a kernel has them.
fn fields(module: &naga::Module, name: &str) -> (Vec<(String, usize)>, usize) {
    let found = module.types.iter().find(|(_, kind)| kind.name.as_deref() == Some(name));
    let naga::TypeInner::Struct { members, span } = &found.unwrap().1.inner else { panic!("{name}") };
    let field = |member: &naga::StructMember| (member.name.clone().unwrap(), member.offset as usize);
    (members.iter().map(field).collect(), *span as usize)
}

macro_rules! offsets {
    ($own:ty, [$($field:ident)*]) => { vec![$((stringify!($field).to_owned(), offset_of!($own, $field))),*] };
}

macro_rules! same {
    ($module:expr, $kernel:literal, $own:ty, [$($field:ident)*]) => {{
        let own = offsets!($own, [$($field)*]);
        assert_eq!(fields($module, $kernel), (own, size_of::<$own>()), "{}", $kernel);
    }};
}

#[test]
fn structs_are_laid_out_alike() {
    for (stage, _, module, _) in modules() {
        same!(&module, "Frame", FrameUniform, [
            k_springs k_integrity tip_scales k_angular gravity k_altitude air drag h inverse_h inverse_dt dftl_damping
            elastic_limit breaking_point breaking_width healing healing_limit clamped flags unknown drag_along
            drag_quadratic shape_global shape_local tip_global tip_local recheck pad_0
        ]);
        same!(&module, "Substep", SubstepUniform, [start end carried_weight level shift pad_1]);
        same!(&module, "Block", BlockEntry, [first particles live points place number]);
        let has = |name: &str| module.types.iter().any(|(_, kind)| kind.name.as_deref() == Some(name));
        let on_grid = matches!(stage.group, Group::Splat | Group::Cells | Group::Gather);
        let among_solids = matches!(stage.group, Group::Air | Group::Follow | Group::Solids | Group::Cells);
        assert_eq!(
            [has("Bounds"), has("Air"), has("Look")],
            [on_grid, stage.group == Group::Air, among_solids],
            "{}",
            stage.name
        );
        if on_grid {
            same!(&module, "Bounds", BoundsEntry, [
                low count dims layer extent fullest lack change held found sweeps listed ratio
                residual
            ]);
            same!(&module, "GridSolid", GridSolidEntry, [local velocity]);
            same!(&module, "Grid", GridUniform, [
                place motion axes cell pic slack expand least unit tolerance capacity solids relaxation room pad_0 each
            ]);
        }
        if matches!(stage.group, Group::Guides | Group::Carried) {
            same!(&module, "Skin", SkinUniform, [head count pad_0 pad_1 pad_2]);
        }
        if stage.group == Group::Carried {
            same!(&module, "Carried", CarriedEntry, [entries fractions weights rest pad_0]);
        }
        if matches!(stage.group, Group::Enter | Group::Touch | Group::Bend) {
            same!(&module, "Meet", MeetUniform, [
                from_start from_end edge distance slip friction spread dt close far spacing inverse_piece
                inverse_particles pad_0 budget most_active few per_segment rounds clamped cells entries numbers bodies
                found joints sides most_actives most_joints strands
            ]);
            // Bins and a list come after what is read back.
            let (mut touch, _) = fields(&module, "Touch");
            let after = touch.split_off(touch.len() - 2);
            assert_eq!(after[0], ("bins".to_owned(), size_of::<TouchEntry>()));
            assert_eq!(
                touch,
                offsets!(TouchEntry, [
                    low spacing high slices dims slice extent squares fastest actives joints taken least bin share found_bin
                    found_share momentum round last done lack farthest shelves
                ])
            );
        }
        if matches!(stage.group, Group::Wet | Group::Cloud) {
            same!(&module, "Fluid", FluidUniform, [
                h h2 inverse_h dt mass_density mass_push mass_drag pressure viscosity inverse_dt neighbours numbers
                buckets own_strand mutual pad_0
            ]);
        }
        if stage.group == Group::Air {
            same!(&module, "Mode", ModeEntry, [wave phase amplitude pad_0]);
            same!(&module, "Air", AirUniform, [
                to_wake from_wake axes mean shelter shift wake_cell stop scale modes solids each
            ]);
            same!(&module, "Canopy", CanopyEntry, [low cell dims pad_0 extent pad_1 pad_2]);
        }
        if among_solids {
            same!(&module, "Solid", SolidEntry, [
                at_end at_start carry spin friction travel kind pivot thinness size cell ball ball_radius origin described dims
                first phases swell fields
            ]);
            same!(&module, "Look", LookUniform, [count how thickness way_out solids]);
        }
        same!(&module, "Report", ReportEntry, [stretch quarantined touching deepest restored contacts]);
    }
}

#[test]
fn bindings_are_those_of_the_table() {
    for (stage, _, module, info) in modules() {
        let used = |handle: naga::Handle<naga::GlobalVariable>| {
            (0..module.entry_points.len()).any(|own| !info.get_entry_point(own)[handle].is_empty())
        };
        let bindings = stage.group.bindings();
        for (handle, variable) in module.global_variables.iter() {
            let Some(place) = variable.binding.filter(|_| used(handle)) else { continue };
            assert_eq!(place.group, 0, "{}", stage.name);
            let name = variable.name.as_deref().unwrap();
            let writes = |space: naga::AddressSpace| match space {
                naga::AddressSpace::Storage { access } => Some(access.contains(naga::StorageAccess::STORE)),
                _ => None,
            };
            let (_, binding) = bindings.iter().find(|(number, _)| *number == place.binding).unwrap();
            let expected = match *binding {
                Binding::Frame => ("frame", None),
                Binding::Substep => ("substep", None),
                Binding::Look => ("look", None),
                Binding::Grid => ("grid", None),
                Binding::Air => ("air", None),
                Binding::Skin => ("skin", None),
                Binding::Meet => ("meet", None),
                Binding::Fluid => ("fluid", None),
                Binding::Read(name) => (name, Some(false)),
                Binding::Change(name) => (name, Some(true)),
            };
            assert_eq!((name, writes(variable.space)), expected, "{}", stage.name);
        }
        let is_storage = |(_, b): &&(u32, Binding)| matches!(b, Binding::Read(_) | Binding::Change(_));
        let storage = bindings.iter().filter(is_storage).count();
        assert!(storage <= 8, "WebGPU grants eight storage buffers a stage, {} has {storage}", stage.name);
    }
}

#[test]
fn kernels_can_be_said_in_metal_directx_and_vulkan() {
    for (stage, subgroups, module, info) in modules() {
        let name = stage.name;
        let mut text = String::new();
        let plain = hlsl::Options::default().shader_model;
        let shader_model = if subgroups { hlsl::ShaderModel::V6_0 } else { plain };
        let options = hlsl::Options { fake_missing_bindings: true, shader_model, ..hlsl::Options::default() };
        let pipeline = hlsl::PipelineOptions::default();
        hlsl::Writer::new(&mut text, &options, &pipeline).write(&module, &info, None).unwrap();
        assert!(stage.kernels.iter().all(|(_, own, _)| text.contains(own)), "HLSL of {name}");
        let options = msl::Options { fake_missing_bindings: true, ..msl::Options::default() };
        let (text, _) =
            msl::write_string(&module, &info, &options, &msl::PipelineOptions::default()).unwrap();
        assert!(stage.kernels.iter().all(|(_, own, _)| text.contains(own)), "MSL of {name}");
        let words = spv::write_vec(&module, &info, &spv::Options::default(), None).unwrap();
        assert_eq!(words[0], 0x0723_0203, "SPIR-V of {name}");
    }
}

/// The checks can fail: two fields that change places are seen.
#[test]
fn fields_that_change_places_are_seen() {
    let whole = text(&STAGES[0], false);
    let moved = whole.replace(
        "    k_integrity: f32,\n    tip_scales: vec3f,\n    k_angular: f32,",
        "    k_angular: f32,\n    tip_scales: vec3f,\n    k_integrity: f32,",
    );
    let [whole, moved] =
        [whole, moved].map(|text| fields(&naga::front::wgsl::parse_str(&text).unwrap(), "Frame"));
    assert_ne!(whole, moved);
}
