//! Stacks as safetensors files that Python opens: one tensor `[networks, ...]` per stack, weight and bias.

use std::borrow::Cow;
use std::collections::{HashMap, HashSet};
use std::fmt::{self, Display};
use std::ops::Range;
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail, ensure};
use safetensors::tensor::{Dtype, SafeTensors, View, serialize, serialize_to_file};
use serde::de::{Deserialize, Deserializer, Error as _, IgnoredAny, MapAccess, Visitor};

use super::{Layout, Rows};

/// Largest absolute value of a parameter that [`read_stack`] takes. Networks that learnt something have parameters below a
/// hundred. The products of far larger ones are infinite, and then a network says nothing.
pub const LARGEST_PARAMETER: f32 = 1e6;

/// A stack to be written by [`write_stacks`].
pub struct StackToWrite<'a> {
    /// Beginning of the names of its tensors.
    pub prefix: &'a str,
    /// Places of its weights and biases.
    pub layout: &'a Layout,
    /// Parameters, one row per network, as `layout` describes them.
    pub rows: Vec<&'a [f32]>,
}

impl StackToWrite<'_> {
    fn tensors(&self) -> impl Iterator<Item = (String, Tensor<'_>)> {
        let StackToWrite { prefix, layout, rows } = self;
        let blocks = layout.blocks(rows.len());
        blocks.map(move |(name, shape, place)| (format!("{prefix}{name}"), Tensor { shape, rows, place }))
    }
}

/// A tensor that becomes bytes only when it is written: a thousand networks need no second copy in memory.
struct Tensor<'a> {
    shape: Vec<usize>,
    rows: &'a [&'a [f32]],
    /// Place of its values in each row.
    place: Range<usize>,
}

impl View for Tensor<'_> {
    fn dtype(&self) -> Dtype {
        Dtype::F32
    }

    fn shape(&self) -> &[usize] {
        &self.shape
    }

    fn data(&self) -> Cow<'_, [u8]> {
        let mut bytes = Vec::with_capacity(self.data_len());
        bytes.extend(self.rows.iter().flat_map(|row| &row[self.place.clone()]).flat_map(|value| value.to_le_bytes()));
        Cow::Owned(bytes)
    }

    fn data_len(&self) -> usize {
        self.rows.len() * self.place.len() * size_of::<f32>()
    }
}

/// Writes the stacks as a safetensors file: one tensor per weight and bias, `[networks, ...]`, under the stack's prefix and
/// the block's name. `about` goes into the file's metadata. Returns an error if the file cannot be written.
pub fn write_stacks(stacks: &[StackToWrite<'_>], about: &HashMap<String, String>, path: &Path) -> Result<()> {
    Ok(serialize_to_file(stacks.iter().flat_map(StackToWrite::tensors), Some(about.clone()), path)?)
}

/// Returns the bytes of a file of [`write_stacks`] with one stack.
pub fn stack_as_bytes(stack: &StackToWrite<'_>) -> Result<Vec<u8>> {
    Ok(serialize(stack.tensors(), None)?)
}

/// Returns the metadata `about` that [`write_stacks`] put into a file. `bytes`: those of the file. If there is none, or the
/// file is damaged: empty.
pub fn about_stacks(bytes: &[u8]) -> HashMap<String, String> {
    let header = SafeTensors::read_metadata(bytes);
    header.ok().and_then(|(_, header)| header.metadata().clone()).unwrap_or_default()
}

/// Makes sure that a file of [`write_stacks`] has no tensors but those of these stacks, each once. A stack is given as its
/// prefix and layout. `bytes`: those of the file. `path` is for messages only.
///
/// A reader takes the tensors that it knows by their names. So it would not see that a file is of another network, or that
/// two programs may read two different tensors of one name.
pub fn check_tensors<'a>(
    bytes: &[u8],
    path: &Path,
    stacks: impl IntoIterator<Item = (&'a str, &'a Layout)>,
) -> Result<()> {
    let header = bytes.split_first_chunk::<8>().and_then(|(length, rest)| {
        let length = usize::try_from(u64::from_le_bytes(*length)).ok()?;
        rest.get(..length)
    });
    let is_none = || format!("{}: not a safetensors file, or cut short", path.display());
    let names: Names =
        serde_json::from_slice(header.with_context(is_none)?).map_err(|error| match error.is_data() {
            true => anyhow!("{}: its header is wrong: {error}", path.display()),
            false => anyhow!(error).context(is_none()),
        })?;
    let own: HashSet<String> = stacks
        .into_iter()
        .flat_map(|(prefix, layout)| layout.blocks(1).map(move |(name, ..)| format!("{prefix}{name}")))
        .collect();
    if let Some(other) = names.0.iter().find(|name| !own.contains(*name)) {
        bail!(
            "{}: the tensor `{other}` belongs to no network of this config: the file is of another run or was changed",
            path.display()
        );
    }
    Ok(())
}

/// Names of the tensors in a header. A name that comes twice is an error, also inside the metadata.
struct Names(Vec<String>);

/// Key of the metadata in a header.
const METADATA: &str = "__metadata__";

impl<'de> Deserialize<'de> for Names {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        struct OfMap;
        impl<'de> Visitor<'de> for OfMap {
            type Value = Names;

            fn expecting(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
                to.write_str("names with values")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> std::result::Result<Names, A::Error> {
                let (mut names, mut seen) = (Vec::new(), HashSet::new());
                while let Some(name) = map.next_key::<String>()? {
                    if !seen.insert(name.clone()) {
                        return Err(A::Error::custom(format_args!("`{name}` comes twice")));
                    }
                    if name == METADATA {
                        map.next_value::<Names>()?;
                    } else {
                        map.next_value::<IgnoredAny>()?;
                        names.push(name);
                    }
                }
                Ok(Names(names))
            }
        }
        deserializer.deserialize_map(OfMap)
    }
}

/// Reads the stack with this `prefix` from a file of [`write_stacks`]. Returns `[names, parameters]`.
///
/// `bytes`: those of the file. `path` and `names`, one per network, are for messages only.
///
/// Returns an error if the file has a different shape, or if a value is not a finite number or beyond
/// [`LARGEST_PARAMETER`].
pub fn read_stack(
    bytes: &[u8],
    path: &Path,
    prefix: &str,
    layout: &Layout,
    names: &[impl Display],
) -> Result<Rows<f32>> {
    let file = SafeTensors::deserialize(bytes)
        .with_context(|| format!("{}: not a safetensors file, or cut short", path.display()))?;
    let mut rows = Rows::new(names.len(), layout.width());
    for (name, shape, place) in layout.blocks(names.len()) {
        let name = format!("{prefix}{name}");
        let tensor = file.tensor(&name).with_context(|| format!("{}: no tensor `{name}`", path.display()))?;
        ensure!(
            tensor.dtype() == Dtype::F32 && tensor.shape() == shape,
            "{}: `{name}` is {:?} {:?}; it must be F32 {shape:?}",
            path.display(),
            tensor.dtype(),
            tensor.shape(),
        );
        for (row, (owner, bytes)) in names.iter().zip(tensor.data().chunks_exact(4 * place.len())).enumerate() {
            let row = &mut rows.row_mut(row)[place.clone()];
            let values = bytes.as_chunks::<4>().0.iter().map(|&value| f32::from_le_bytes(value));
            row.iter_mut().zip(values).for_each(|(to, from)| *to = from);
            if let Some(bad) = row.iter().find(|value| !value.is_finite()) {
                bail!(
                    "{}: `{name}` of {owner} holds {bad}, which is not a finite number: the file is damaged; \
                     copy it again from an undamaged one, or train again",
                    path.display()
                );
            }
            if let Some(huge) = row.iter().find(|value| value.abs() > LARGEST_PARAMETER) {
                bail!(
                    "{}: `{name}` of {owner} holds {huge:e}, and {LARGEST_PARAMETER:e} is the largest that is taken: the \
                     file is damaged, or its training diverged; copy it again from an undamaged one, or train again",
                    path.display()
                );
            }
        }
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::stack;
    use crate::{Shape, Stack};

    #[test]
    fn stacks_of_one_file_come_back_by_their_prefixes() {
        let shape = |inputs| Shape { inputs, recurrent: None, hidden: vec![5], outputs: 2, apart: 0, sets: None };
        let nets = [stack(shape(4), &[0, 2]), stack(shape(3), &[1])];
        let [first, second] = nets.each_ref().map(Stack::parameters);
        let stacks = [("a.", first), ("b.", second)].map(|(prefix, parameters)| StackToWrite {
            prefix,
            layout: parameters.layout(),
            rows: parameters.values().iter().collect(),
        });
        let file = tempfile::NamedTempFile::new().unwrap();
        let path = file.path();
        write_stacks(&stacks, &HashMap::new(), path).unwrap();
        let read = |prefix: &str, layout: &Layout, networks: usize| {
            let names: Vec<usize> = (0..networks).collect();
            read_stack(&std::fs::read(path).unwrap(), path, prefix, layout, &names)
        };
        assert_eq!(read("a.", first.layout(), 2).unwrap(), *first.values());
        assert_eq!(read("b.", second.layout(), 1).unwrap(), *second.values());
        let error = read("", first.layout(), 2).unwrap_err().to_string();
        assert!(error.contains("no tensor `layers.0.weight`"), "{error}");
        let check =
            |stacks: &[(&str, &Layout)]| check_tensors(&std::fs::read(path).unwrap(), path, stacks.iter().copied());
        check(&[("a.", first.layout()), ("b.", second.layout())]).unwrap();
        let error = check(&[("b.", second.layout())]).unwrap_err().to_string();
        assert!(error.contains("the tensor `a.layers.") && error.contains("belongs to no network"), "{error}");
    }

    #[test]
    fn a_name_that_comes_twice_is_an_error_that_names_it() {
        let layout = Shape { inputs: 1, recurrent: None, hidden: vec![], outputs: 1, apart: 0, sets: None }.layout();
        let check = |header: &str| {
            let bytes = [&(header.len() as u64).to_le_bytes()[..], header.as_bytes()].concat();
            check_tensors(&bytes, Path::new("x"), [("", &layout)])
        };
        check(r#"{"__metadata__": {"steps": "1"}, "layers.0.weight": {}, "layers.0.bias": {}}"#).unwrap();
        for (header, name) in [
            (r#"{"layers.0.weight": {}, "layers.0.weight": {}}"#, "`layers.0.weight` comes twice"),
            (r#"{"__metadata__": {"steps": "1", "steps": "2"}}"#, "`steps` comes twice"),
        ] {
            let error = format!("{:#}", check(header).unwrap_err());
            assert!(error.starts_with("x: its header is wrong: ") && error.contains(name), "{error}");
        }
        assert!(check_tensors(&[255; 8], Path::new("x"), [("", &layout)]).is_err(), "a length beyond the file");
    }

    #[test]
    fn a_parameter_beyond_the_largest_is_an_error_that_names_its_tensor() {
        let mut net =
            stack(Shape { inputs: 4, recurrent: None, hidden: vec![5], outputs: 2, apart: 0, sets: None }, &[0, 2]);
        let mut rows = net.parameters().values().clone();
        rows.row_mut(1)[0] = -1.5e6;
        net.parameters_mut().load(&rows);
        let layout = net.parameters().layout();
        let stack = StackToWrite { prefix: "", layout, rows: net.parameters().values().iter().collect() };
        let error = read_stack(&stack_as_bytes(&stack).unwrap(), Path::new("x"), "", layout, &["one", "two"]);
        let error = error.unwrap_err().to_string();
        assert!(error.starts_with("x: `layers.0.weight` of two holds -1.5e6, and 1e6 is the largest"), "{error}");
    }
}
