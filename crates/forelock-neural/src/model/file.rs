//! Bytes of a model.

use super::error::one_line;
use super::{FORMAT_VERSION, Model, ModelError, ModelInfo};
use crate::EDGES;
use crate::codes::Encoder;
use crate::codes::encoder::{ENCODER, INPUTS, Layer};
use crate::network::rotation::Basis;
use crate::network::{Network, OUTPUTS, Shape};
use safetensors::tensor::{Metadata, TensorInfo};
use safetensors::{Dtype, SafeTensors};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;

/// The most bytes of a model's file: 64 MiB, forty times the usual ones.
pub const MOST_BYTES: u64 = 64 << 20;

/// The metadata's key of the JSON text.
const INFO: &str = "forelock";
/// The metadata's key of the checksum.
const CHECKSUM: &str = "forelock.checksum";
/// Bytes before the header: its length.
const LENGTH_BYTES: usize = 8;
/// The most bytes of a header: 4 MiB. Read, a header takes some times the memory of its text.
const MOST_HEADER: u64 = 4 << 20;

/// A tensor of a model.
pub(super) struct Tensor<'a> {
    shape: Vec<usize>,
    data: Cow<'a, [f32]>,
}

impl Tensor<'_> {
    /// Checks that all numbers are finite.
    pub fn check_finite(&self, name: &str) -> Result<(), ModelError> {
        match self.data.iter().position(|x| !x.is_finite()) {
            Some(index) => {
                let value = self.data[index];
                Err(ModelError::NotFinite { tensor: name.into(), index, byte: None, value })
            }
            None => Ok(()),
        }
    }
}

/// The header of a file as it is written.
#[derive(Serialize)]
struct Header<'a> {
    #[serde(rename = "__metadata__")]
    texts: BTreeMap<&'a str, &'a str>,
    #[serde(flatten)]
    tensors: BTreeMap<&'a str, TensorInfo>,
}

/// The part of the JSON text that tells whether the rest can be understood.
#[derive(Deserialize)]
struct Version {
    version: u64,
}

impl Model {
    /// All tensors, in the order of their names.
    pub(super) fn tensors(&self) -> BTreeMap<String, Tensor<'_>> {
        let Shape { statics, shared, width, outputs } = *self.network.shape();
        let [static_part, shared_part, first_bias, hidden, second_bias, output, third_bias] =
            self.network.parts();
        let basis: Vec<f32> = self.basis.as_flattened().iter().map(|x| *x as f32).collect();
        let mut all = BTreeMap::new();
        let mut add = |name: String, shape: &[usize], data| {
            all.insert(name, Tensor { shape: shape.to_vec(), data });
        };
        add("simulator.static".into(), &[statics, width], Cow::from(static_part));
        add("simulator.static.bias".into(), &[width], first_bias.into());
        add("simulator.shared".into(), &[shared, width], shared_part.into());
        add("simulator.hidden".into(), &[width, width], hidden.into());
        add("simulator.hidden.bias".into(), &[width], second_bias.into());
        add("simulator.output".into(), &[width, outputs], output.into());
        add("simulator.output.bias".into(), &[outputs], third_bias.into());
        add("simulator.basis".into(), &[EDGES, EDGES], basis.into());
        for (number, layer) in self.encoder.layers().iter().enumerate() {
            let units = layer.bias.len();
            let shape = [layer.weights.len() / units, units];
            add(format!("encoder.{number}.weight"), &shape, Cow::from(&layer.weights));
            add(format!("encoder.{number}.bias"), &[units], Cow::from(&layer.bias));
        }
        all
    }

    /// The bytes of the model's file. The same model gives the same bytes.
    ///
    /// # Errors
    /// If the model has more bytes, or more metadata, than a file that can be read.
    pub fn to_bytes(&self) -> Result<Vec<u8>, ModelError> {
        let text = serde_json::to_string(&self.info).map_err(bad_text)?;
        let tensors = self.tensors();
        let mut checksum = Fnv::new();
        checksum.add(text.as_bytes());
        let mut data = Vec::new();
        let mut infos = BTreeMap::new();
        for (name, tensor) in &tensors {
            let first = data.len();
            data.extend(tensor.data.iter().flat_map(|x| x.to_le_bytes()));
            checksum.add_tensor(name, &tensor.shape, &data[first..]);
            let data_offsets = (first, data.len());
            let info = TensorInfo { dtype: Dtype::F32, shape: tensor.shape.clone(), data_offsets };
            infos.insert(name.as_str(), info);
        }
        let checksum = checksum.text();
        let texts = BTreeMap::from([(INFO, text.as_str()), (CHECKSUM, &checksum)]);
        let header = Header { texts, tensors: infos };
        let mut header = serde_json::to_vec(&header).map_err(bad_text)?;
        // The tensors begin at a multiple of eight bytes.
        header.resize(header.len().next_multiple_of(LENGTH_BYTES), b' ');
        let bytes = [&(header.len() as u64).to_le_bytes(), header.as_slice(), &data].concat();
        check_size(bytes.len() as u64)?;
        if header.len() as u64 > MOST_HEADER {
            let problem = format!("{} bytes of metadata are more than {MOST_HEADER}", header.len());
            return Err(ModelError::Info { field: "training".into(), problem });
        }
        Ok(bytes)
    }

    /// The model of a file's bytes.
    ///
    /// # Errors
    /// [`ModelError`] tells what is wrong and where. No input makes this panic, and no tensor is
    /// allocated that the bytes do not hold.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, ModelError> {
        check_size(bytes.len() as u64)?;
        let broken = |reason| ModelError::Format { bytes: bytes.len(), reason };
        if let Some(length) = bytes.first_chunk()
            && u64::from_le_bytes(*length) > MOST_HEADER
        {
            return Err(broken(format!("bytes 0 to 7 give its header more than {MOST_HEADER} bytes")));
        }
        let (header, metadata) =
            SafeTensors::read_metadata(bytes).map_err(|error| broken(one_line(&error)))?;
        let reader = Reader { bytes, start: LENGTH_BYTES + header, metadata };
        let text = reader.text(INFO)?;
        let Version { version } = serde_json::from_str(text).map_err(bad_text)?;
        if version != u64::from(FORMAT_VERSION) {
            return Err(ModelError::Version { found: version });
        }
        reader.check_checksum(text)?;
        let info: ModelInfo = serde_json::from_str(text).map_err(bad_text)?;
        info.check()?;
        let encoder = reader.encoder()?;
        let network = reader.network(&encoder, &info)?;
        let basis = reader.basis()?;
        Self::new(network, &basis, encoder, info)
    }

    /// Writes the model's file. The bytes go to a file beside `path`, which is renamed when it is
    /// complete: an existing file is replaced as a whole, or not at all.
    ///
    /// # Errors
    /// If the model has no bytes ([`Self::to_bytes`]), or the operating system reports an error.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<(), ModelError> {
        let path = path.as_ref();
        let bytes = self.to_bytes()?;
        let write = || {
            let mut builder = tempfile::Builder::new();
            builder.prefix(".forelock-").suffix(".part");
            // Temporary files are private by default; this one becomes an ordinary file.
            #[cfg(unix)]
            builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
            let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
            let mut file = builder.tempfile_in(folder.unwrap_or(Path::new(".")))?;
            file.write_all(&bytes)?;
            file.persist(path)?;
            Ok(())
        };
        write().map_err(|error| ModelError::Io { path: path.into(), action: "write", error })
    }

    /// Reads a model's file.
    ///
    /// # Errors
    /// If the operating system reports an error, or as in [`Self::from_bytes`], with the path.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, ModelError> {
        let path = path.as_ref();
        let io = |error| ModelError::Io { path: path.into(), action: "read", error };
        let in_file = |error| ModelError::File { path: path.into(), error: Box::new(error) };
        let file = File::open(path).map_err(io)?;
        check_size(file.metadata().map_err(io)?.len()).map_err(in_file)?;
        let mut bytes = Vec::new();
        file.take(MOST_BYTES + 1).read_to_end(&mut bytes).map_err(io)?;
        Self::from_bytes(&bytes).map_err(in_file)
    }
}

/// A JSON text that is not what it should be.
fn bad_text(error: serde_json::Error) -> ModelError {
    ModelError::Metadata(one_line(&error))
}

fn check_size(bytes: u64) -> Result<(), ModelError> {
    if bytes > MOST_BYTES { Err(ModelError::TooLarge { bytes }) } else { Ok(()) }
}

/// A file whose header agrees with its length.
struct Reader<'a> {
    bytes: &'a [u8],
    /// The byte at which the tensors begin.
    start: usize,
    metadata: Metadata,
}

impl Reader<'_> {
    /// A text of the metadata.
    fn text(&self, key: &'static str) -> Result<&str, ModelError> {
        let texts = self.metadata.metadata().as_ref();
        texts.and_then(|texts| texts.get(key)).map(String::as_str).ok_or(ModelError::Foreign { key })
    }

    /// Checks the checksum of the JSON text and all tensors.
    fn check_checksum(&self, text: &str) -> Result<(), ModelError> {
        let stated = self.text(CHECKSUM)?;
        let mut checksum = Fnv::new();
        checksum.add(text.as_bytes());
        let infos = self.metadata.tensors();
        for (name, info) in infos.iter().collect::<BTreeMap<_, _>>() {
            checksum.add_tensor(name, &info.shape, self.data(info));
        }
        let found = checksum.text();
        if stated == found { Ok(()) } else { Err(ModelError::Checksum { stated: one_line(&stated), found }) }
    }

    /// A tensor's bytes. The header was compared with the length of the file.
    fn data(&self, info: &TensorInfo) -> &[u8] {
        let (from, to) = info.data_offsets;
        self.bytes.get(self.start + from..self.start + to).unwrap_or_default()
    }

    /// Sizes and numbers of a tensor. Where `expected` has a size, the tensor must have it; any
    /// other size is at least 1.
    fn tensor<const N: usize>(
        &self,
        name: &str,
        expected: [Option<usize>; N],
    ) -> Result<([usize; N], Vec<f32>), ModelError> {
        let info = self.metadata.info(name).ok_or_else(|| ModelError::Missing(name.into()))?;
        if info.dtype != Dtype::F32 {
            return Err(ModelError::Type { tensor: name.into(), found: info.dtype.to_string() });
        }
        let suits = |shape: &[usize; N]| {
            shape
                .iter()
                .zip(expected)
                .all(|(size, expected)| *size > 0 && expected.is_none_or(|e| e == *size))
        };
        let shape = <[usize; N]>::try_from(info.shape.as_slice()).ok().filter(suits).ok_or_else(|| {
            let sizes = expected.map(|size| size.map_or("any".into(), |size| size.to_string()));
            let expected = format!("[{}]", sizes.join(", "));
            ModelError::Shape {
                tensor: name.into(),
                found: info.shape.iter().copied().take(8).collect(),
                expected,
            }
        })?;
        let (words, _) = self.data(info).as_chunks();
        let numbers: Vec<f32> = words.iter().map(|word| f32::from_le_bytes(*word)).collect();
        if let Some(index) = numbers.iter().position(|x| !x.is_finite()) {
            let byte = Some(self.start + info.data_offsets.0 + 4 * index);
            let value = numbers[index];
            return Err(ModelError::NotFinite { tensor: name.into(), index, byte, value });
        }
        Ok((shape, numbers))
    }

    fn encoder(&self) -> Result<Encoder, ModelError> {
        let mut inputs = INPUTS;
        let mut layers = Vec::new();
        for number in 0..ENCODER {
            let ([_, units], weights) =
                self.tensor(&format!("encoder.{number}.weight"), [Some(inputs), None])?;
            let (_, bias) = self.tensor(&format!("encoder.{number}.bias"), [Some(units)])?;
            layers.push(Layer { weights, bias });
            inputs = units;
        }
        Ok(Encoder::of(layers))
    }

    fn network(&self, encoder: &Encoder, info: &ModelInfo) -> Result<Network<f32>, ModelError> {
        let statics = Some(2 + 2 * encoder.code_len());
        let ([statics, width], static_part) = self.tensor("simulator.static", [statics, None])?;
        let units = Some(width);
        let (_, first_bias) = self.tensor("simulator.static.bias", [units])?;
        let ([shared, _], shared_part) = self.tensor("simulator.shared", [info.shared_inputs(), units])?;
        let (_, hidden) = self.tensor("simulator.hidden", [units, units])?;
        let (_, second_bias) = self.tensor("simulator.hidden.bias", [units])?;
        let (_, output) = self.tensor("simulator.output", [units, Some(OUTPUTS)])?;
        let (_, third_bias) = self.tensor("simulator.output.bias", [Some(OUTPUTS)])?;
        let parameters =
            [static_part, shared_part, first_bias, hidden, second_bias, output, third_bias].concat();
        Ok(Network::of(Shape { statics, shared, width, outputs: OUTPUTS }, parameters))
    }

    fn basis(&self) -> Result<Basis, ModelError> {
        let (_, numbers) = self.tensor("simulator.basis", [Some(EDGES); 2])?;
        let mut basis = [[0.0; EDGES]; EDGES];
        for (to, from) in basis.as_flattened_mut().iter_mut().zip(numbers) {
            *to = f64::from(from);
        }
        Ok(basis)
    }
}

/// The 64-bit FNV-1a hash (Fowler, Noll and Vo; RFC 9923). A change of a single byte always
/// changes it.
struct Fnv(u64);

impl Fnv {
    fn new() -> Self {
        Self(0xCBF2_9CE4_8422_2325)
    }

    fn add(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01B3);
        }
    }

    fn add_tensor(&mut self, name: &str, shape: &[usize], bytes: &[u8]) {
        self.add(name.as_bytes());
        for size in shape {
            self.add(&(*size as u64).to_le_bytes());
        }
        self.add(bytes);
    }

    fn text(&self) -> String {
        format!("{:016x}", self.0)
    }
}
