//! Files of models: whole ones, and ones that are broken in some way.

#![expect(clippy::unwrap_used, clippy::expect_used, reason = "a test fails where a file is not as expected")]

use forelock_core::lane::Simd;
use forelock_neural::codes::encoder::{CODE, CodeOptions, INPUTS, StrandCodes};
use forelock_neural::codes::{LocksError, crown_uv, encoder_inputs, static_inputs};
use forelock_neural::losses::body::BodyTerms;
use forelock_neural::losses::elastic::Transport;
use forelock_neural::losses::style::StyleTerms;
use forelock_neural::model::{
    InputsError, MOST_BYTES, Model, ModelError, ModelInfo, ModelKind, OutputHead, StrandAtRest,
};
use forelock_neural::network::inference::Positions;
use forelock_neural::network::rotation::{Basis, basis};
use forelock_neural::network::{Network, STATICS, Shape};
use forelock_neural::random::Random;
use forelock_neural::train::Energies;
use glam::DVec3;
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};
use serde_json::{Value, json};
use std::collections::{BTreeMap, HashMap};
use std::fs;

/// A network of random weights.
fn network(shape: Shape) -> Network<f32> {
    let mut random = Random::new(5);
    let mut weights: Vec<f32> = (0..shape.parameters()).map(|_| 0.1 * random.signed() as f32).collect();
    // What a comparison of values, or a way through text, would lose.
    weights[..4].copy_from_slice(&[-0.0, 1e-42, f32::MAX, f32::EPSILON]);
    Network::new(shape, weights).unwrap()
}

/// Codes with random weights.
fn codes() -> StrandCodes {
    StrandCodes::train(&[[0.0; INPUTS]], &CodeOptions { steps: 0, ..CodeOptions::default() }, &mut || ())
}

fn usual_basis() -> Basis {
    basis(100.0, 1e-4, 1.0 / 30.0)
}

/// Metadata whose numbers have no short decimal form.
fn info() -> ModelInfo {
    let energies = Energies {
        body: BodyTerms { tail: f64::INFINITY, ..BodyTerms::default() },
        style: Some(StyleTerms::default()),
        ..Energies::default()
    };
    let mut info = ModelInfo::new(&energies, 0.1 + 0.2);
    info.training.seed = u64::MAX;
    info.training.grooms = vec!["straight".into(), "wavy \"β\"".into()];
    let mut random = Random::new(6);
    info.measures = (0..50).map(|k| (format!("measure {k}"), random.normal())).collect();
    info
}

fn model_of(width: usize) -> Model {
    let network = network(Shape { width, ..Shape::default() });
    Model::new(network, &usual_basis(), codes().encoder(), info()).unwrap()
}

/// The bytes of a small model.
fn small_file() -> Vec<u8> {
    model_of(8).to_bytes().unwrap()
}

/// A file taken apart, to be put together again with a fault.
#[derive(Clone)]
struct Parts {
    texts: HashMap<String, String>,
    tensors: BTreeMap<String, Tensor>,
}

#[derive(Clone)]
struct Tensor {
    dtype: Dtype,
    shape: Vec<usize>,
    data: Vec<u8>,
}

impl Parts {
    fn of(file: &[u8]) -> Self {
        let (_, metadata) = SafeTensors::read_metadata(file).unwrap();
        let tensors = SafeTensors::deserialize(file).unwrap();
        let tensor = |(name, view): (&str, TensorView<'_>)| {
            let (dtype, shape) = (view.dtype(), view.shape().to_vec());
            (name.to_string(), Tensor { dtype, shape, data: view.data().to_vec() })
        };
        Self { texts: metadata.metadata().clone().unwrap(), tensors: tensors.iter().map(tensor).collect() }
    }

    /// The file, with the checksum that the module's page describes.
    fn file(mut self) -> Vec<u8> {
        let text = self.texts.get("forelock").cloned().unwrap_or_default();
        let mut hashed = text.into_bytes();
        for (name, tensor) in &self.tensors {
            hashed.extend(name.as_bytes());
            hashed.extend(tensor.shape.iter().flat_map(|size| (*size as u64).to_le_bytes()));
            hashed.extend(&tensor.data);
        }
        let hash = hashed.iter().fold(0xCBF2_9CE4_8422_2325u64, |hash, byte| {
            (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01B3)
        });
        self.texts.insert("forelock.checksum".into(), format!("{hash:016x}"));
        self.file_as_it_is()
    }

    fn file_as_it_is(&self) -> Vec<u8> {
        let views = self.tensors.iter().map(|(name, tensor)| {
            let view = TensorView::new(tensor.dtype, tensor.shape.clone(), &tensor.data);
            (name.clone(), view.unwrap())
        });
        safetensors::serialize(views, Some(self.texts.clone())).unwrap()
    }

    fn with_json(&self, change: impl FnOnce(&mut Value)) -> Vec<u8> {
        let mut json = serde_json::from_str(&self.texts["forelock"]).unwrap();
        change(&mut json);
        let mut parts = self.clone();
        parts.texts.insert("forelock".into(), json.to_string());
        parts.file()
    }

    fn with_tensor(&self, name: &str, change: impl FnOnce(&mut Tensor)) -> Vec<u8> {
        let mut parts = self.clone();
        change(parts.tensors.get_mut(name).unwrap());
        parts.file()
    }
}

/// The error of a broken file: a message of one line.
fn refused(file: &[u8]) -> ModelError {
    let error = Model::from_bytes(file).expect_err("a broken file is refused");
    let message = error.to_string();
    assert!(message.len() > 20 && message.len() < 500 && !message.contains('\n'), "{message}");
    error
}

/// Bytes that begin with the length of a header.
fn headed(length: u64, rest: &[u8]) -> Vec<u8> {
    [&length.to_le_bytes(), rest].concat()
}

#[test]
fn a_round_trip_is_bit_exact_and_the_same_model_gives_the_same_bytes() {
    let model = model_of(256);
    let file = model.to_bytes().unwrap();
    let read = Model::from_bytes(&file).unwrap();
    assert_eq!(read, model);
    assert_eq!(read.info(), &info());
    assert_eq!(read.info().energies().body.tail, f64::INFINITY);
    let bits = |model: &Model| model.network().parameters().iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&read), bits(&model));
    assert_eq!(read.to_bytes().unwrap(), file);
    assert_eq!(model_of(256).to_bytes().unwrap(), file);
    // A tool that writes the same contents in its own way keeps the model whole.
    assert_eq!(Model::from_bytes(&Parts::of(&file).file_as_it_is()).unwrap(), model);
}

#[test]
fn the_simulator_takes_at_most_1_2_megabytes_and_other_readers_understand_the_file() {
    let file = model_of(256).to_bytes().unwrap();
    let tensors = SafeTensors::deserialize(&file).unwrap();
    let bytes = |prefix: &str| -> usize {
        tensors.iter().filter(|(name, _)| name.starts_with(prefix)).map(|(_, view)| view.data().len()).sum()
    };
    assert_eq!(bytes("simulator."), 1_104_160 + 2_304);
    assert!(bytes("simulator.") <= 1_200_000);
    assert_eq!(bytes("encoder."), 4 * (75 * 256 + 256 + 256 * 256 + 256 + 256 * 32 + 32));
    assert_eq!(tensors.tensor("simulator.shared").unwrap().shape(), [682, 256]);
    // Tensors begin at a multiple of eight bytes.
    assert_eq!(u64::from_le_bytes(file[..8].try_into().unwrap()) % 8, 0);
}

#[test]
fn files_are_replaced_as_a_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("model.safetensors");
    fs::write(&path, "older").unwrap();
    let model = model_of(8);
    model.write(&path).unwrap();
    assert_eq!(Model::read(&path).unwrap(), model);
    assert_eq!(fs::read(&path).unwrap(), model.to_bytes().unwrap());
    assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);

    let nowhere = folder.path().join("none").join("model.safetensors");
    assert!(matches!(model.write(&nowhere), Err(ModelError::Io { .. })));
    let error = Model::read(&nowhere).unwrap_err();
    assert!(matches!(error, ModelError::Io { .. }) && error.to_string().contains("none"), "{error}");
    fs::create_dir(folder.path().join("folder")).unwrap();
    assert!(model.write(folder.path().join("folder")).is_err());
    assert!(Model::read(folder.path().join("folder")).is_err());
    assert_eq!(fs::read_dir(&folder).unwrap().count(), 2);

    fs::write(&path, []).unwrap();
    let error = Model::read(&path).unwrap_err().to_string();
    assert!(error.contains("model.safetensors: the 0 bytes are no whole safetensors file"), "{error}");
    // A sparse file, which takes no room.
    fs::File::create(&path).unwrap().set_len(MOST_BYTES + 1).unwrap();
    let Err(ModelError::File { error, .. }) = Model::read(&path) else { panic!("too large") };
    assert!(matches!(*error, ModelError::TooLarge { bytes } if bytes == MOST_BYTES + 1));
}

#[test]
fn truncated_files_are_refused() {
    let file = small_file();
    let header = 8 + u64::from_le_bytes(file[..8].try_into().unwrap()) as usize;
    let near = |at: usize| at - 4..at + 4;
    let lengths = (0..16).chain(near(header)).chain((16..file.len()).step_by(file.len() / 150));
    let mut count = 0;
    for length in lengths.chain([file.len() - 1]) {
        assert!(matches!(refused(&file[..length]), ModelError::Format { bytes, .. } if bytes == length));
        count += 1;
    }
    assert!(count > 150);
    for more in [1, 8, 4096] {
        let longer = [file.as_slice(), &vec![0; more]].concat();
        assert!(matches!(refused(&longer), ModelError::Format { .. }));
    }
    // The whole one is read.
    Model::from_bytes(&file).unwrap();
}

#[test]
fn a_flipped_bit_is_found_wherever_it_is() {
    let mut file = small_file();
    let header = 8 + u64::from_le_bytes(file[..8].try_into().unwrap()) as usize;
    let in_header = (0..8 * header).step_by(5);
    let in_tensors = (8 * header..8 * file.len()).step_by(8 * (file.len() - header) / 300 + 1);
    let mut count = 0;
    for bit in in_header.chain(in_tensors) {
        file[bit / 8] ^= 1 << (bit % 8);
        let error = refused(&file);
        if bit >= 8 * header {
            assert!(matches!(error, ModelError::Checksum { .. }), "{error}");
        }
        file[bit / 8] ^= 1 << (bit % 8);
        count += 1;
    }
    assert!(count > 3000, "{count}");
    Model::from_bytes(&file).unwrap();
}

#[test]
fn weights_that_are_not_finite_are_named_with_their_place() {
    let parts = Parts::of(&small_file());
    for (name, tensor) in &parts.tensors {
        let last = tensor.data.len() / 4 - 1;
        for (wrong, index) in [(f32::NAN, last), (f32::INFINITY, 0), (f32::NEG_INFINITY, last / 2)] {
            let file = parts.with_tensor(name, |tensor| {
                tensor.data[4 * index..][..4].copy_from_slice(&wrong.to_le_bytes());
            });
            let error = refused(&file);
            let ModelError::NotFinite { tensor, index: found, byte: Some(byte), .. } = &error else {
                panic!("{error}");
            };
            assert_eq!((tensor, *found), (name, index));
            assert_eq!(file[*byte..][..4], wrong.to_le_bytes());
        }
    }
    let shape = Shape { width: 8, ..Shape::default() };
    let mut weights = network(shape);
    weights.parameters_mut()[70] = f32::NAN;
    let error = Model::new(weights, &usual_basis(), codes().encoder(), info()).unwrap_err();
    assert_eq!(error.to_string(), "tensor `simulator.static`, number 70: NaN is not finite; train again");
    // 1e39 has no float32.
    assert!(Model::new(network(shape), &[[1e39; 24]; 24], codes().encoder(), info()).is_err());
}

#[test]
fn tensors_that_are_missing_or_of_another_shape_or_type_are_named() {
    let parts = Parts::of(&small_file());
    assert_eq!(parts.tensors.len(), 14);
    for (name, tensor) in &parts.tensors {
        let mut without = parts.clone();
        without.tensors.remove(name);
        assert!(matches!(refused(&without.file()), ModelError::Missing(found) if &found == name));

        let is_named = |file: &[u8]| {
            let error = refused(file);
            assert!(matches!(&error, ModelError::Shape { tensor, .. } if tensor == name), "{error}");
        };
        is_named(&parts.with_tensor(name, |tensor| tensor.shape.insert(0, 1)));
        is_named(&parts.with_tensor(name, |tensor| tensor.shape = vec![tensor.data.len() / 4, 1, 1]));
        // No bytes, whatever the other size claims.
        is_named(&parts.with_tensor(name, |tensor| {
            tensor.data.clear();
            tensor.shape[0] = 0;
            if let Some(size) = tensor.shape.get_mut(1) {
                *size = 1 << 60;
            }
        }));
        if let [inputs, units] = tensor.shape[..] {
            // One row fewer. Encoder layers and the first one are found by what follows them.
            is_named(&parts.with_tensor(name, |tensor| {
                tensor.shape[0] -= 1;
                tensor.data.truncate(4 * (inputs - 1) * units);
            }));
        }
        for dtype in [Dtype::I32, Dtype::U32] {
            let error = refused(&parts.with_tensor(name, |tensor| tensor.dtype = dtype));
            assert!(matches!(&error, ModelError::Type { tensor, .. } if tensor == name), "{error}");
        }
    }
    // A tensor that nobody knows does no harm.
    let mut with_more = parts.clone();
    let more = Tensor { dtype: Dtype::U8, shape: vec![3], data: vec![1, 2, 3] };
    with_more.tensors.insert("decoder.0.weight".into(), more);
    assert_eq!(Model::from_bytes(&with_more.file()).unwrap(), model_of(8));
}

#[test]
fn parts_that_do_not_suit_each_other_make_no_model() {
    let of = |shape: Shape, info: ModelInfo| {
        Model::new(network(shape), &usual_basis(), codes().encoder(), info).map_err(|error| error.to_string())
    };
    let shape = Shape { width: 8, ..Shape::default() };
    let named = |shape: Shape, name: &str| {
        let error = of(shape, info()).unwrap_err();
        assert!(error.contains(name) && error.contains("it is of another network"), "{error}");
    };
    named(Shape { statics: 65, ..shape }, "simulator.static");
    named(Shape { shared: 34, ..shape }, "simulator.shared");
    named(Shape { outputs: 75, ..shape }, "simulator.output");
    named(Shape { width: 0, ..shape }, "simulator.hidden");
    // Without a history, a frame has 34 numbers.
    let mut still = Energies::default();
    still.motion.is_dynamic = false;
    let still = ModelInfo::new(&still, 1.0);
    assert_eq!((still.kind, still.history), (ModelKind::QuasiStatic, 0));
    let model = of(Shape { shared: 34, ..shape }, still.clone()).unwrap();
    assert_eq!(Model::from_bytes(&model.to_bytes().unwrap()).unwrap(), model);
    assert!(of(shape, still).is_err());
}

#[test]
fn files_of_something_else_are_told_apart() {
    let parts = Parts::of(&small_file());
    for key in ["forelock", "forelock.checksum"] {
        let mut foreign = parts.clone();
        foreign.texts.remove(key);
        assert!(
            matches!(refused(&foreign.file_as_it_is()), ModelError::Foreign { key: found } if found == key)
        );
    }
    assert!(matches!(refused(&headed(2, b"{}")), ModelError::Foreign { .. }));
    // A later version is named before anything else that it may do in another way.
    let mut later = parts.clone();
    later.texts = HashMap::from([("forelock".into(), json!({ "version": 2 }).to_string())]);
    assert!(matches!(refused(&later.file_as_it_is()), ModelError::Version { found: 2 }));
    let mut other = parts.clone();
    other.texts.insert("forelock.checksum".into(), "0123456789abcdef\n".repeat(100));
    assert!(matches!(refused(&other.file_as_it_is()), ModelError::Checksum { .. }));
    for text in ["", "{", "[]", "{\"version\": -1}", "{\"version\": 1e400}", "\u{0}", &"[".repeat(100_000)] {
        let mut other = parts.clone();
        other.texts.insert("forelock".into(), text.into());
        assert!(matches!(refused(&other.file()), ModelError::Metadata(_)), "{text:.20}");
    }
}

#[test]
fn headers_that_promise_too_much_allocate_nothing() {
    for length in [1 << 30, 1 << 60, u64::MAX, u64::MAX - 7, 99_999_999] {
        assert!(matches!(refused(&headed(length, b"{}")), ModelError::Format { .. }));
    }
    let promise = |shape: &str, to: &str| {
        let header = format!(r#"{{"a":{{"dtype":"F32","shape":{shape},"data_offsets":[0,{to}]}}}}"#);
        refused(&headed(header.len() as u64, header.as_bytes()))
    };
    for (shape, to) in [
        ("[268435456]", "1073741824"),
        ("[288230376151711744]", "1152921504606846976"),
        ("[4611686018427387904]", "18446744073709551612"),
        ("[18446744073709551615,18446744073709551615]", "4"),
        ("[18446744073709551616]", "4"),
        ("[1]", "-4"),
    ] {
        assert!(matches!(promise(shape, to), ModelError::Format { .. }));
    }
    // A header within a file of its length, but longer than any model's.
    let long = [b"{}".as_slice(), &[b' '; 5 << 20]].concat();
    assert!(refused(&headed(long.len() as u64, &long)).to_string().contains("bytes 0 to 7"));
    let mut wordy = info();
    wordy.training.motions = vec!["a clip".repeat(1 << 20)];
    let network = network(Shape { width: 8, ..Shape::default() });
    let wordy = Model::new(network, &usual_basis(), codes().encoder(), wordy).unwrap();
    assert!(matches!(wordy.to_bytes(), Err(ModelError::Info { .. })));
    let deep = "[".repeat(100_000);
    for rest in [deep.as_bytes(), b"\xFF\xFE{}", b"null", b"{\"a\":null}", b"\n\n\n\n"] {
        assert!(matches!(refused(&headed(rest.len() as u64, rest)), ModelError::Format { .. }));
    }
}

#[test]
fn fields_that_are_missing_or_wrong_are_named_and_unknown_ones_passed_over() {
    let parts = Parts::of(&small_file());
    let named = |field: &str, file: &[u8]| {
        let message = refused(file).to_string();
        assert!(message.contains(&format!("`{field}`")), "{field}: {message}");
    };
    let json: Value = serde_json::from_str(&parts.texts["forelock"]).unwrap();
    for field in json.as_object().unwrap().keys() {
        let file = parts.with_json(|json| drop(json.as_object_mut().unwrap().remove(field)));
        if field == "shape_digest" {
            Model::from_bytes(&file).unwrap();
        } else {
            named(field, &file);
        }
    }
    for (group, field) in [("energies", "drag"), ("training", "seed"), ("scales", "angular")] {
        named(field, &parts.with_json(|json| drop(json[group].as_object_mut().unwrap().remove(field))));
    }
    for (field, value) in [
        ("units", json!("m, kg, s\n")),
        ("joints", json!(["head"])),
        ("history", json!(0)),
        ("dt_secs", json!(0.0)),
        ("dt_secs", json!(-1.0)),
        ("code_deviation", json!(1e-60)),
        ("scales", json!({ "angular": 1.0, "velocity": 1.0, "specific_force": 1.0, "encoder": 1.0 })),
        ("simulator.shared", json!(null)),
    ] {
        let history = |json: &mut Value| json["history"] = json!(usize::MAX);
        let set = |json: &mut Value| json[field] = value.clone();
        named(field, &if value.is_null() { parts.with_json(history) } else { parts.with_json(set) });
    }
    for (field, expected) in [
        ("kind", "`quasi-static`"),
        ("head", "`displacement`"),
        ("transport", "`chord`"),
        ("head_motion", "`specific-force`"),
        ("uv_map", "`crown`"),
    ] {
        let message = refused(&parts.with_json(|json| json[field] = json!("other"))).to_string();
        assert!(message.contains("`other`") && message.contains(expected), "{message}");
    }
    let more = parts.with_json(|json| json["later"] = json!({ "unknown": [1, 2] }));
    assert_eq!(Model::from_bytes(&more).unwrap(), model_of(8));
    // What JSON cannot hold is refused before it is written.
    let mut wrong = info();
    wrong.measures.insert("corr".into(), f64::NAN);
    let network = network(Shape { width: 8, ..Shape::default() });
    let error = Model::new(network, &usual_basis(), codes().encoder(), wrong).unwrap_err();
    assert_eq!(error.to_string(), "metadata `forelock`, field `measures.corr`: NaN must be finite");
}

/// A change of one value in a JSON text, `next` values from its start. `false` past its end.
fn replace(json: &mut Value, next: &mut usize, value: &Value) -> bool {
    if *next == 0 {
        *json = value.clone();
        return true;
    }
    *next -= 1;
    match json {
        Value::Array(items) => items.iter_mut().any(|item| replace(item, next, value)),
        Value::Object(fields) => fields.values_mut().any(|field| replace(field, next, value)),
        _ => false,
    }
}

#[test]
fn any_value_in_place_of_another_is_refused_or_kept() {
    let mut few = info();
    few.measures.retain(|name, _| name == "measure 7");
    let small = Shape { width: 1, ..Shape::default() };
    let model = Model::new(network(small), &usual_basis(), codes().encoder(), few).unwrap();
    let parts = Parts::of(&model.to_bytes().unwrap());
    let [mut refusals, mut others] = [0; 2];
    let values = [json!(null), json!(-1), json!(1e308), json!(u64::MAX), json!("\n"), json!([]), json!({})];
    for value in values {
        for place in 0.. {
            let (mut next, mut is_inside) = (place, false);
            let file = parts.with_json(|json| is_inside = replace(json, &mut next, &value));
            if !is_inside {
                break;
            }
            if let Ok(model) = Model::from_bytes(&file) {
                assert_eq!(Model::from_bytes(&model.to_bytes().unwrap()).unwrap(), model);
                others += 1;
            } else {
                refused(&file);
                refusals += 1;
            }
        }
    }
    assert!(refusals > 200 && others > 40, "{refusals} {others}");
}

/// Strands in all directions from the head's centre.
fn strands(count: usize) -> Vec<StrandAtRest> {
    let mut random = Random::new(8);
    let mut one = || {
        let direction = DVec3::new(random.signed(), random.signed(), random.signed());
        let step = DVec3::new(random.signed(), -1.0, random.signed());
        let x = |i: usize| (9.0 * direction.normalize() + 0.5 * i as f64 * step).as_vec3().to_array();
        StrandAtRest { particles: std::array::from_fn(x), normal: 2.0 * direction, direction }
    };
    (0..count).map(|_| one()).collect()
}

#[test]
fn inputs_of_strands_are_those_of_training() {
    let (model, codes, strands) = (model_of(8), codes(), strands(150));
    let found = model.strand_inputs(&strands, Simd::Auto).unwrap();
    assert_eq!(found.len(), STATICS * strands.len());
    let shape = |strand: &StrandAtRest| {
        let points = strand.particles.map(|x| DVec3::from(x.map(f64::from)));
        encoder_inputs(&points, strand.normal).unwrap()
    };
    let uv: Vec<[f64; 2]> = strands.iter().map(|strand| crown_uv(strand.direction).unwrap()).collect();
    let shapes: Vec<_> = strands.iter().map(shape).collect();
    let own: Vec<[f32; CODE]> = shapes.iter().map(|x| codes.encode(x)).collect();
    let expected = static_inputs(&uv, own.as_flattened(), info().code_deviation as f32).unwrap();
    for (found, expected) in found.iter().zip(&expected) {
        assert!((found - expected).abs() < 1e-4, "{found} {expected}");
    }
    // A code does not depend on the other strands.
    let encoder = codes.encoder();
    assert_eq!(encoder.code_len(), CODE);
    let all = encoder.encode(&shapes, Simd::Auto);
    assert_eq!(all[149 * CODE..], encoder.encode(&shapes[149..], Simd::Auto));

    let mut wrong = strands.clone();
    wrong[77].normal = DVec3::ZERO;
    let error = model.strand_inputs(&wrong, Simd::Auto).unwrap_err();
    assert!(error.to_string().starts_with("strand 77: the direction (0, 0, 0)"), "{error}");
    wrong[12].particles[24][1] = f32::NAN;
    assert!(matches!(model.strand_inputs(&wrong, Simd::Auto), Err(InputsError::Strand { strand: 12, .. })));
    assert_eq!(model.strand_inputs(&[], Simd::Auto), Err(InputsError::Locks(LocksError::Empty)));
}

#[test]
fn a_model_that_was_read_predicts_what_the_written_one_does() {
    let strands = strands(70);
    let rest: Vec<Positions> = strands.iter().map(|strand| strand.particles).collect();
    let shared: Vec<f32> = (0..682).map(|k| (k as f32).sin()).collect();
    let mut random = Random::new(9);
    let shape = Shape { width: 16, ..Shape::default() };
    let weights = (0..shape.parameters()).map(|_| 0.1 * random.signed() as f32).collect();
    let network = Network::new(shape, weights).unwrap();
    let model = Model::new(network, &usual_basis(), codes().encoder(), info()).unwrap();
    let predict = |model: &Model| {
        let statics = model.strand_inputs(&strands, Simd::Auto).unwrap();
        let predictor = model.predictor(Simd::Auto).unwrap();
        let prepared = predictor.prepare(&rest, &statics).unwrap();
        let mut out = vec![[[0.0; 3]; 25]; rest.len()];
        predictor.predict(&prepared, &shared, &mut out);
        out
    };
    let found = predict(&Model::from_bytes(&model.to_bytes().unwrap()).unwrap());
    assert_eq!(found, predict(&model));
    assert_ne!(found, rest);

    let mut paper = info();
    (paper.head, paper.transport) = (OutputHead::Displacement, Transport::Direct);
    let paper = Model::new(model.network().clone(), model.basis(), model.encoder().clone(), paper).unwrap();
    let read = Model::from_bytes(&paper.to_bytes().unwrap()).unwrap();
    assert_eq!(read.info().transport, Transport::Direct);
    assert_eq!(read.predictor(Simd::Auto).unwrap().head(), OutputHead::Displacement);
    assert_ne!(predict(&read), found);
}
