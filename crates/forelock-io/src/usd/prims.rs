//! The prims that the tables of a crate file describe.

use std::{
    collections::{BTreeMap, HashMap},
    io::{Read, Seek},
    rc::Rc,
};

use super::{
    UsdError,
    crate_file::{ATTRIBUTE, Crate, LAYER, PRIM, Path, Spec, Tables},
    layer::{Attribute, Held, Prim, Value},
    values::{PAYLOAD, TOKEN_VECTOR},
};

/// A spec has fewer fields.
const MOST_FIELDS: usize = 1024;

type Fields = BTreeMap<Rc<str>, Held>;

/// A prim, before all are in order.
struct Found {
    /// The number of its path, and that of its parent if this is a prim.
    path: u32,
    parent: Option<u32>,
    name: Rc<str>,
    fields: Fields,
}

impl Tables {
    /// The metadata of the layer.
    pub fn metadata<R: Read + Seek>(&self, file: &Crate<R>) -> Result<Fields, UsdError> {
        let layer = self.specs.iter().find(|spec| spec.kind == LAYER);
        layer.map_or_else(|| Ok(Fields::new()), |layer| self.fields(layer, file))
    }

    /// The prims with their attributes, in the order of the layer, parents first.
    pub fn prims<R: Read + Seek>(&self, file: &Crate<R>) -> Result<Vec<Prim>, UsdError> {
        let found = self.found(file)?;
        let mut indices: HashMap<u32, usize> = HashMap::new();
        let mut prims = Vec::with_capacity(found.len());
        for index in self.order(&found, file)? {
            let Found { path, parent, name, fields } = &found[index];
            indices.insert(*path, prims.len());
            let parent = parent.and_then(|parent| indices.get(&parent).copied());
            let kind = fields.get("typeName").and_then(small);
            let kind = kind.and_then(|token| file.tokens.get(token as usize)).cloned();
            let kind = kind.unwrap_or_else(|| "".into());
            prims.push(Prim { name: Rc::clone(name), kind, parent, attributes: BTreeMap::new() });
        }
        for spec in self.specs.iter().filter(|spec| spec.kind == ATTRIBUTE) {
            let path = self.path(spec.path, file)?;
            let prim = path.parent.and_then(|parent| indices.get(&parent));
            let name = file.tokens.get(path.token as usize);
            let (Some(&prim), Some(name), true) = (prim, name, path.is_property) else { continue };
            let mut fields = self.fields(spec, file)?;
            let attribute =
                Attribute { default: fields.remove("default"), samples: fields.remove("timeSamples") };
            prims[prim].attributes.insert(Rc::clone(name), attribute);
        }
        Ok(prims)
    }

    /// The prims that are defined and active, with all their parents.
    fn found<R: Read + Seek>(&self, file: &Crate<R>) -> Result<Vec<Found>, UsdError> {
        // Parents must come before their children.
        let mut specs: Vec<(Path, &Spec)> = Vec::new();
        for spec in self.specs.iter().filter(|spec| spec.kind == PRIM) {
            specs.push((self.path(spec.path, file)?, spec));
        }
        specs.sort_by_key(|(path, _)| path.depth);
        let mut is_found = vec![false; self.paths.len()];
        let mut found = Vec::new();
        for (path, spec) in specs {
            let Some(name) = file.tokens.get(path.token as usize) else {
                return Err(self.invalid(file, format!("a path has no token {}", path.token)));
            };
            let parent = path.parent.filter(|&parent| is_found[parent as usize]);
            let fields = self.fields(spec, file)?;
            // Children of the root have the depth 1; the others need a parent. A path that occurs
            // in two specs counts once.
            let is_placed = parent.is_some() || path.depth == 1;
            if is_read(&fields) && is_placed && !std::mem::replace(&mut is_found[spec.path as usize], true) {
                found.push(Found { path: spec.path, parent, name: Rc::clone(name), fields });
            }
        }
        Ok(found)
    }

    /// The order of the prims: each before its children, which stand as `primChildren` lists them.
    fn order<R: Read + Seek>(&self, found: &[Found], file: &Crate<R>) -> Result<Vec<usize>, UsdError> {
        let mut children: HashMap<Option<u32>, Vec<usize>> = HashMap::new();
        for (index, prim) in found.iter().enumerate() {
            children.entry(prim.parent).or_default().push(index);
        }
        let mut order = Vec::with_capacity(found.len());
        let top = self.metadata(file)?;
        let mut open: Vec<Option<usize>> = vec![None];
        while let Some(prim) = open.pop() {
            let (path, fields) = prim.map_or((None, &top), |i| (Some(found[i].path), &found[i].fields));
            let mut own = children.remove(&path).unwrap_or_default();
            if own.len() > 1 {
                let listed = self.listed(fields, own.len(), file)?;
                own.sort_by_key(|&child| listed.get(&found[child].name).copied().unwrap_or(usize::MAX));
            }
            // The last one is opened first, so each subtree is put before its siblings.
            open.extend(own.into_iter().rev().map(Some));
            order.extend(prim);
        }
        Ok(order)
    }

    /// The places of the children's names in `primChildren`. A list that is much longer than the
    /// `count` children is not read.
    fn listed<R: Read + Seek>(
        &self,
        fields: &Fields,
        count: usize,
        file: &Crate<R>,
    ) -> Result<HashMap<Rc<str>, usize>, UsdError> {
        let Some(Held::Packed(value)) = fields.get("primChildren") else { return Ok(HashMap::new()) };
        let stored: u64 = file.source.at(value & PAYLOAD).value("a count")?;
        if (value >> 48) & 0xff != TOKEN_VECTOR || stored > 2 * count as u64 + 64 {
            return Ok(HashMap::new());
        }
        match file.unpack(*value)? {
            Value::Words(words) => Ok(words.into_iter().enumerate().map(|(i, word)| (word, i)).collect()),
            _ => Ok(HashMap::new()),
        }
    }

    fn path<R: Read + Seek>(&self, index: u32, file: &Crate<R>) -> Result<Path, UsdError> {
        let path = self.paths.get(index as usize).copied().flatten();
        path.ok_or_else(|| self.invalid(file, format!("a spec names path {index}, which is not there")))
    }

    /// The fields of `spec` by name.
    fn fields<R: Read + Seek>(&self, spec: &Spec, file: &Crate<R>) -> Result<Fields, UsdError> {
        let set = self.sets.get(spec.set as usize..).unwrap_or_default();
        let length = set.iter().take(MOST_FIELDS).position(|&field| field == u32::MAX);
        let Some(length) = length else {
            return Err(self.invalid(file, format!("the fields of path {} have no end", spec.path)));
        };
        let field = |&field: &u32| {
            let &(name, value) = self.fields.get(field as usize)?;
            Some((Rc::clone(file.tokens.get(name as usize)?), Held::Packed(value)))
        };
        let fields: Option<Fields> = set[..length].iter().map(field).collect();
        fields.ok_or_else(|| {
            self.invalid(file, format!("the spec of path {} has a field that is not there", spec.path))
        })
    }

    fn invalid<R: Read + Seek>(&self, file: &Crate<R>, words: String) -> UsdError {
        file.source.at(self.contents).invalid(words)
    }
}

/// Whether a prim with these fields is defined and active.
fn is_read(fields: &Fields) -> bool {
    // The specifiers are 0 `def`, 1 `over`, 2 `class`.
    fields.get("specifier").and_then(small) == Some(0) && fields.get("active").and_then(small) != Some(0)
}

/// The number or index that is the value itself.
fn small(held: &Held) -> Option<u32> {
    match held {
        Held::Packed(value) => u32::try_from(value & 0xffff_ffff).ok(),
        Held::Value(_) => None,
    }
}
