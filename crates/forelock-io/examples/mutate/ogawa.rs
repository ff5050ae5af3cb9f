//! An Alembic file with meshes that move, byte by byte: the crate writes none.

/// The bit of a reference that stands for data.
const DATA: u64 = 1 << 63;

/// Types of values.
const U8: u32 = 1;
const I32: u32 = 6;
const F32: u32 = 10;
const F64: u32 = 11;

/// A property: its name, type, values of an item, and its samples, of which those that follow each
/// other are equal where an index is repeated.
struct Property<'a> {
    name: &'a str,
    is_array: bool,
    kind: u32,
    extent: u32,
    samples: Vec<Vec<u8>>,
    /// Which of them each time has.
    order: &'a [usize],
}

/// A file that grows.
struct File(Vec<u8>);

impl File {
    fn data(&mut self, bytes: &[u8]) -> u64 {
        if bytes.is_empty() {
            return DATA;
        }
        let at = self.0.len() as u64;
        self.0.extend((bytes.len() as u64).to_le_bytes());
        self.0.extend(bytes);
        at | DATA
    }

    fn group(&mut self, children: &[u64]) -> u64 {
        let at = self.0.len() as u64;
        self.0.extend((children.len() as u64).to_le_bytes());
        children.iter().for_each(|child| self.0.extend(child.to_le_bytes()));
        at
    }

    /// The group of a compound with `properties`, in a compound `name`.
    fn compound(&mut self, name: &str, properties: &[Property<'_>]) -> u64 {
        let (mut parts, mut headers) = (Vec::new(), Vec::new());
        for own in properties {
            let sample = |bytes: &Vec<u8>| self.data(&[&[7; 16], &**bytes].concat());
            let stored: Vec<u64> = own.samples.iter().map(sample).collect();
            let each = if own.is_array { 2 } else { 1 };
            let list = own.order.iter().flat_map(|&at| [stored[at], DATA].into_iter().take(each));
            parts.push(self.group(&list.collect::<Vec<_>>()));
            let still = u32::from(own.order.len() == 1) << 11;
            let flags =
                (if own.is_array { 2 } else { 1 }) | 2 << 2 | own.kind << 4 | still | own.extent << 12;
            for number in [flags, own.order.len() as u32, own.name.len() as u32] {
                headers.extend(number.to_le_bytes());
            }
            headers.extend(own.name.bytes());
        }
        parts.push(self.data(&headers));
        let inner = self.group(&parts);
        let mut headers: Vec<u8> = (2u32 << 2).to_le_bytes().to_vec();
        headers.extend((name.len() as u32).to_le_bytes());
        headers.extend(name.bytes());
        let headers = self.data(&headers);
        self.group(&[inner, headers])
    }

    /// The group of an object with `properties` and children: name, metadata and group.
    fn object(&mut self, properties: u64, children: &[(&str, &str, u64)]) -> u64 {
        let mut headers = Vec::new();
        for (name, metadata, _) in children {
            headers.extend((name.len() as u32).to_le_bytes());
            headers.extend(name.bytes());
            headers.push(255);
            headers.extend((metadata.len() as u32).to_le_bytes());
            headers.extend(metadata.bytes());
        }
        headers.extend([0; 32]);
        let headers = self.data(&headers);
        let groups = children.iter().map(|child| child.2);
        let parts: Vec<u64> = std::iter::once(properties).chain(groups).chain([headers]).collect();
        self.group(&parts)
    }
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

fn property<'a>(
    name: &'a str,
    kind: u32,
    extent: u32,
    samples: Vec<Vec<u8>>,
    order: &'a [usize],
) -> Property<'a> {
    let is_array = !matches!(name, ".ops" | ".vals" | ".inherits");
    Property { name, is_array, kind, extent, samples, order }
}

/// A mesh that bends, and one that turns, below a transform that moves both; samples are shared.
pub fn body() -> Vec<u8> {
    let mut file = File(b"Ogawa\xff\0\x01\0\0\0\0\0\0\0\0".to_vec());
    let corner = |k: u16| [f32::from(k % 3), f32::from(k / 3), 0.1 * f32::from(k * k)];
    let still: Vec<f32> = (0..9).flat_map(corner).collect();
    let bent: Vec<f32> = still.iter().enumerate().map(|(i, x)| x + 0.01 * (i * i) as f32).collect();
    let whole = |numbers: &[i32]| -> Vec<u8> { numbers.iter().flat_map(|n| n.to_le_bytes()).collect() };
    let counts = whole(&[4, 4, 3, 3]);
    let corners = whole(&[0, 1, 4, 3, 1, 2, 5, 4, 3, 4, 7, 4, 5, 8]);
    let mut mesh = |samples: Vec<Vec<u8>>, order: &[usize]| {
        let properties = [
            property("P", F32, 3, samples, order),
            property(".faceCounts", I32, 1, vec![counts.clone()], &[0]),
            property(".faceIndices", I32, 1, vec![corners.clone()], &[0]),
        ];
        let geom = file.compound(".geom", &properties);
        file.object(geom, &[])
    };
    let bends = mesh(vec![floats(&still), floats(&bent)], &[0, 1, 1, 0, 1]);
    let turns = mesh(vec![floats(&still)], &[0]);
    let schema = "schema=AbcGeom_PolyMesh_v1;schemaBaseType=AbcGeom_GeomBase_v1";
    let vals = |x: f64| -> Vec<u8> { [x, 2.0, 0.5, 30.0 * x].iter().flat_map(|v| v.to_le_bytes()).collect() };
    let all = vec![vals(0.0), vals(1.0), vals(2.0)];
    let moves = [
        property(".ops", U8, 2, vec![vec![0x10, 0x60]], &[0]),
        property(".vals", F64, 4, all, &[0, 1, 2, 1, 0]),
        property(".inherits", U8, 1, vec![vec![1]], &[0]),
    ];
    let moves = file.compound(".xform", &moves);
    let head = file.object(moves, &[("bends", schema, bends), ("turns", schema, turns)]);
    let top = file.object(0, &[("head", "schema=AbcGeom_Xform_v3", head)]);
    let [version, library] = [0i32, 10_803].map(|number| file.data(&number.to_le_bytes()));
    let metadata = file.data(b"_ai_Application=mutate");
    let mut sampling = Vec::new();
    sampling.extend(5u32.to_le_bytes());
    sampling.extend((1.0f64 / 24.0).to_le_bytes());
    sampling.extend(1u32.to_le_bytes());
    sampling.extend(0.0f64.to_le_bytes());
    let samplings = file.data(&sampling);
    let indexed = file.data(&[]);
    let root = file.group(&[version, library, top, metadata, samplings, indexed]);
    file.0[8..16].copy_from_slice(&root.to_le_bytes());
    file.0
}
