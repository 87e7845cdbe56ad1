//! Stacks as safetensors files that Python opens: one tensor `[networks, ...]` per stack, weight and bias.

use std::borrow::Cow;
use std::collections::HashMap;
use std::fmt::Display;
use std::ops::Range;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use safetensors::tensor::{Dtype, SafeTensors, View, serialize, serialize_to_file};

use super::{Layout, Rows};

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

/// Reads the stack with this `prefix` from a file of [`write_stacks`]. Returns `[names, parameters]`.
///
/// `bytes`: those of the file. `path` and `names`, one per network, are for messages only.
///
/// Returns an error if the file has a different shape, or if a value is not a finite number.
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
        let shape = |inputs| Shape { inputs, recurrent: None, hidden: vec![5], outputs: 2, apart: 0 };
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
    }
}
