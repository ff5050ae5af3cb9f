//! Every shader is valid, declares the bindings of its WGSL, lays structs out as Rust does, and can
//! be translated.

#![expect(clippy::unwrap_used, reason = "in a test a failure to build is a failure of the test")]

use forelock_gpu::acceleration::LatticeUniform;
use forelock_gpu::air::{AirUniform, CanopyEntry, ModeEntry};
use forelock_gpu::collide::{QueryUniform, SolidEntry};
use forelock_gpu::guides::{CarriedEntry, SkinUniform};
use forelock_gpu::interaction::contact::{ContactUniform, TouchEntry};
use forelock_gpu::interaction::grid::{BoundsEntry, GridSolidEntry, GridUniform};
use forelock_gpu::interaction::sph::FluidUniform;
use forelock_gpu::kernel::{Binding, BindingKind, Shader};
use forelock_gpu::network::{BlendEntry, PlacingUniform};
use forelock_gpu::roots::{RootEntry, SurfaceUniform};
use forelock_gpu::skin::{InfluenceEntry, SkinnedUniform};
use forelock_gpu::uniforms::{BlockEntry, ChannelRowEntry, FrameUniform, ReportEntry, SubstepUniform};
use naga::back::{hlsl, msl, spv};
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use std::collections::BTreeSet;
use std::mem::offset_of;
use std::path::Path;

/// A shader as naga reads it.
struct Parsed {
    shader: &'static Shader,
    subgroups: bool,
    module: naga::Module,
    info: ModuleInfo,
}

impl Parsed {
    /// The name of the shader, for messages.
    fn name(&self) -> String {
        format!("{} with {}", self.shader.stage, self.shader.layout.name)
    }
}

fn parse(source: &str) -> naga::Module {
    naga::front::wgsl::parse_str(source).unwrap_or_else(|error| panic!("{}", error.emit_to_string(source)))
}

/// Each shader, for devices with subgroups and without.
fn shaders() -> impl Iterator<Item = Parsed> {
    let sources = forelock_gpu::shaders().flat_map(|shader| [false, true].map(|own| (shader, own)));
    sources.map(|(shader, subgroups)| {
        let source = shader.source(subgroups);
        let module = parse(&source);
        // No capability beyond WebGPU but subgroups; every device packs halves.
        let halves = (source.contains("unpack2x16float"), Capabilities::SHADER_FLOAT16_IN_FLOAT32);
        let needed = [halves, (subgroups, Capabilities::SUBGROUP)];
        let needed = needed.into_iter().filter(|(is, _)| *is).map(|(_, capability)| capability);
        let mut validator = Validator::new(ValidationFlags::all(), needed.collect());
        validator.subgroup_stages(naga::valid::ShaderStages::COMPUTE);
        validator.subgroup_operations(naga::valid::SubgroupOperationSet::all());
        let info = validator.validate(&module).unwrap_or_else(|error| panic!("{}: {error:?}", shader.stage));
        Parsed { shader, subgroups, module, info }
    })
}

/// The Rust files below `folder`.
fn sources(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let read = |path: std::path::PathBuf| match path.is_dir() {
        true => sources(&path),
        false if path.extension().is_some_and(|own| own == "rs") => {
            vec![std::fs::read_to_string(path).unwrap()]
        }
        false => Vec::new(),
    };
    entries.flat_map(read).collect()
}

#[test]
fn every_declared_shader_is_tested() {
    let declared: usize = sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"))
        .iter()
        .map(|text| text.lines().filter(|line| *line == "shader! {").count())
        .sum();
    let listed: Vec<*const Shader> = forelock_gpu::shaders().map(std::ptr::from_ref).collect();
    assert!(declared > 15, "{declared}");
    assert_eq!(listed.len(), declared);
    assert_eq!(listed.iter().collect::<BTreeSet<_>>().len(), declared, "a shader is listed twice");
}

#[test]
fn shaders_need_nothing_beyond_webgpu_and_declare_their_entry_points() {
    for parsed in shaders() {
        let entries: BTreeSet<_> = parsed.module.entry_points.iter().map(|entry| &*entry.name).collect();
        let declared: BTreeSet<_> = parsed.shader.kernels.iter().map(|kernel| kernel.entry).collect();
        assert_eq!(entries, declared, "{}", parsed.name());
        assert_eq!(declared.len(), parsed.shader.kernels.len(), "{}", parsed.name());
        assert!(parsed.shader.kernels.iter().all(|kernel| std::ptr::eq(kernel.shader, parsed.shader)));
    }
}

/// A struct of Rust: its WGSL name, its fields with their offsets, its size.
struct Layout {
    name: &'static str,
    fields: Vec<(String, usize)>,
    size: usize,
    /// Fields of the WGSL struct after those of Rust.
    more: usize,
}

macro_rules! layout {
    ($name:literal, $own:ty, [$($field:ident)*], $more:literal) => {
        Layout {
            name: $name,
            fields: vec![$((stringify!($field).to_owned(), offset_of!($own, $field))),*],
            size: size_of::<$own>(),
            more: $more,
        }
    };
    ($name:literal, $own:ty, [$($field:ident)*]) => { layout!($name, $own, [$($field)*], 0) };
}

fn layouts() -> Vec<Layout> {
    vec![
        layout!("Frame", FrameUniform, [
            k_springs k_integrity tip_scales k_angular gravity k_altitude air drag h inverse_h inverse_dt length_damping
            elastic_limit breaking_point breaking_width healing healing_limit clamped flags unknown drag_along
            drag_quadratic shape_global shape_local tip_global tip_local recheck least_mass length_limit
            stretch_compliance bend_compliance rotation_weight keep iterations channel_rows held
        ]),
        layout!("Substep", SubstepUniform, [
            start end carried_weight level shift share_at_start rotation spin share_at_end
            inverse_span
        ]),
        layout!("ChannelRow", ChannelRowEntry, [at_start at_end starts kind component]),
        layout!("Block", BlockEntry, [first particles live points place number]),
        layout!("Report", ReportEntry, [stretch quarantined touching deepest restored contacts]),
        layout!("Bounds", BoundsEntry, [
            low count dims layer extent densest lack change held found sweeps listed ratio residual
        ]),
        layout!("GridSolid", GridSolidEntry, [local velocity]),
        layout!("Grid", GridUniform, [
            place motion axes cell pic slack expand least unit tolerance capacity solids relaxation volumes each
        ]),
        layout!("Placing", PlacingUniform, [pose displaces], 0),
        layout!("Blend", BlendEntry, [first count weights]),
        layout!("Skin", SkinUniform, [head count pad_0 pad_1 pad_2]),
        layout!("Carried", CarriedEntry, [entries fractions weights rest pad_0]),
        layout!("Skinned", SkinnedUniform, [vertices influences pad_0 pad_1]),
        layout!("Influence", InfluenceEntry, [bone weight]),
        layout!("Surface", SurfaceUniform, [triangles corners roots frames start end pad_0 pad_1]),
        layout!("Root", RootEntry, [corners pad_0 own pad_1 barycentric pad_2 offset pad_3]),
        layout!("Contacts", ContactUniform, [
            from_start from_end edge distance slip friction spread dt close far spacing inverse_piece
            inverse_particles hold budget most_active few per_segment rounds clamped cells entries numbers bodies
            found joints sides most_actives most_joints strands
        ]),
        // Bins and a list follow what is read back.
        layout!("Touch", TouchEntry, [
            low spacing high slices dims slice extent squares fastest actives joints taken least bin share found_bin
            found_share momentum round last done lack farthest stores_entries
        ], 2),
        layout!("Fluid", FluidUniform, [
            h h2 inverse_h dt mass_density mass_push mass_drag pressure viscosity inverse_dt neighbours numbers buckets
            own_strand mutual pad_0
        ]),
        layout!("Mode", ModeEntry, [wave phase amplitude pad_0]),
        layout!("Air", AirUniform, [
            to_wake from_wake axes mean shelter shift wake_cell stop scale modes solids each
        ]),
        layout!("Lattice", LatticeUniform, [low per_metre]),
        layout!("Canopy", CanopyEntry, [low cell dims pad_0 extent pad_1 pad_2]),
        layout!("Solid", SolidEntry, [
            at_end at_start carry spin friction travel kind pivot thinness size cell ball ball_radius origin described
            dims first phases swell fields body
        ]),
        layout!("Query", QueryUniform, [count how thickness max_push_out slow_edges max_edge_push stretch_limit pad_2 solids]),
    ]
}

/// What differs between a struct in WGSL and in Rust, if anything does.
fn difference(module: &naga::Module, kind: naga::Handle<naga::Type>, layout: &Layout) -> Option<String> {
    let naga::TypeInner::Struct { members, span } = &module.types[kind].inner else {
        return Some(format!("{} is no struct", layout.name));
    };
    let field = |member: &naga::StructMember| (member.name.clone().unwrap(), member.offset as usize);
    let mut fields: Vec<_> = members.iter().map(field).collect();
    let after = fields.split_off(fields.len().saturating_sub(layout.more));
    let size = after.first().map_or(*span as usize, |(_, offset)| *offset);
    ((&fields, size) != (&layout.fields, layout.size))
        .then(|| format!("{}: {fields:?}, {size}; {:?}, {}", layout.name, layout.fields, layout.size))
}

/// The structs that `kind` consists of, itself included.
fn structs_of(module: &naga::Module, kind: naga::Handle<naga::Type>) -> Vec<naga::Handle<naga::Type>> {
    match &module.types[kind].inner {
        naga::TypeInner::Array { base, .. } => structs_of(module, *base),
        naga::TypeInner::Struct { members, .. } => {
            let inner = members.iter().flat_map(|member| structs_of(module, member.ty));
            std::iter::once(kind).chain(inner).collect()
        }
        _ => Vec::new(),
    }
}

/// Every struct in a buffer of a shader is the same in Rust, field by field.
#[test]
fn structs_have_the_layout_of_rust() {
    let layouts = layouts();
    let mut seen = BTreeSet::new();
    for Parsed { module, shader, .. } in shaders() {
        for (_, variable) in module.global_variables.iter().filter(|(_, own)| own.binding.is_some()) {
            for kind in structs_of(&module, variable.ty) {
                let name = module.types[kind].name.as_deref().unwrap();
                let layout = layouts.iter().find(|layout| layout.name == name);
                let layout = layout.unwrap_or_else(|| panic!("{}: no Rust struct for {name}", shader.stage));
                assert_eq!(difference(&module, kind, layout), None, "{}", shader.stage);
                seen.insert(layout.name);
            }
        }
    }
    assert_eq!(seen.len(), layouts.len(), "{seen:?}");
}

/// What differs between the bindings that a shader declares and those that its entry points use, if
/// anything does.
fn wrong_binding(parsed: &Parsed, declared: &[Binding]) -> Option<String> {
    let Parsed { module, info, .. } = parsed;
    let used = |handle: naga::Handle<naga::GlobalVariable>| {
        (0..module.entry_points.len()).any(|own| !info.get_entry_point(own)[handle].is_empty())
    };
    for (handle, variable) in module.global_variables.iter() {
        let Some(place) = variable.binding.filter(|_| used(handle)) else { continue };
        let name = variable.name.as_deref().unwrap();
        let Some(binding) = declared.iter().find(|own| own.number == place.binding && place.group == 0)
        else {
            return Some(format!("{name} at {place:?} is not declared"));
        };
        let is_right = match (variable.space, binding.kind) {
            (naga::AddressSpace::Uniform, BindingKind::Uniform(size) | BindingKind::DynamicUniform(size)) => {
                size == module.types[variable.ty].inner.size(module.to_ctx()) as usize
            }
            (naga::AddressSpace::Storage { access }, kind) => {
                let writes = access.contains(naga::StorageAccess::STORE);
                kind == if writes { BindingKind::ReadWrite } else { BindingKind::Read }
            }
            _ => false,
        };
        if !is_right || binding.name != name {
            return Some(format!("{name} in {:?} is not {binding:?}", variable.space));
        }
    }
    None
}

#[test]
fn declared_bindings_are_those_of_the_wgsl() {
    for parsed in shaders() {
        let layout = parsed.shader.layout;
        assert_eq!(wrong_binding(&parsed, layout.bindings), None, "{}", parsed.name());
        let storage = layout.bindings.iter().filter(|own| own.kind.is_storage()).count();
        assert!(storage <= 8, "WebGPU guarantees eight storage buffers, {} has {storage}", layout.name);
        assert!(layout.bindings.is_sorted_by_key(|own| own.number), "{}", layout.name);
    }
}

/// The check of bindings fails on a wrong name, number, access or size, and on a missing binding.
#[test]
fn wrong_bindings_are_found() {
    let parsed = shaders().next().unwrap();
    let right = parsed.shader.layout.bindings;
    let is_found = |change: &dyn Fn(&mut Vec<Binding>)| {
        let mut bindings = right.to_vec();
        change(&mut bindings);
        wrong_binding(&parsed, &bindings).is_some()
    };
    let at = |name: &str| right.iter().position(|own| own.name == name).unwrap();
    let (frame, positions) = (at("frame"), at("positions"));
    assert!(!is_found(&|_| ()));
    assert!(is_found(&|all| all[positions].name = "velocities"));
    assert!(is_found(&|all| all[positions].number = 99));
    assert!(is_found(&|all| all[positions].kind = BindingKind::Read));
    assert!(is_found(&|all| all[frame].kind = BindingKind::Uniform(16)));
    assert!(is_found(&|all| {
        all.remove(positions);
    }));
}

#[test]
fn shaders_translate_to_metal_directx_and_vulkan() {
    for parsed in shaders() {
        let Parsed { shader, subgroups, module, info } = &parsed;
        let name = parsed.name();
        let mut text = String::new();
        let plain = hlsl::Options::default().shader_model;
        let shader_model = if *subgroups { hlsl::ShaderModel::V6_0 } else { plain };
        let options = hlsl::Options { fake_missing_bindings: true, shader_model, ..hlsl::Options::default() };
        let pipeline = hlsl::PipelineOptions::default();
        hlsl::Writer::new(&mut text, &options, &pipeline).write(module, info, None).unwrap();
        assert!(shader.kernels.iter().all(|own| text.contains(own.entry)), "HLSL of {name}");
        let options = msl::Options { fake_missing_bindings: true, ..msl::Options::default() };
        let (text, _) = msl::write_string(module, info, &options, &msl::PipelineOptions::default()).unwrap();
        assert!(shader.kernels.iter().all(|own| text.contains(own.entry)), "MSL of {name}");
        let words = spv::write_vec(module, info, &spv::Options::default(), None).unwrap();
        assert_eq!(words[0], 0x0723_0203, "SPIR-V of {name}");
    }
}

/// The check of structs fails on two fields that changed places.
#[test]
fn swapped_fields_are_found() {
    let whole = forelock_gpu::shaders().next().unwrap().source(false);
    let swapped = whole.replace(
        "    k_integrity: f32,\n    tip_scales: vec3f,\n    k_angular: f32,",
        "    k_angular: f32,\n    tip_scales: vec3f,\n    k_integrity: f32,",
    );
    assert_ne!(whole, swapped);
    let frame = &layouts()[0];
    let [right, wrong] = [whole, swapped].map(|source| {
        let module = parse(&source);
        let kind = module.types.iter().find(|(_, kind)| kind.name.as_deref() == Some("Frame")).unwrap().0;
        difference(&module, kind, frame)
    });
    assert!(right.is_none() && wrong.is_some());
}
