//! The bytes of a checkpoint: tensors, a text about them, and one digest of both.
//!
//! The metadata of the safetensors file has two keys, and its values are text. `checkpoint` is a JSON object.
//! `digest` is the SHA-256 of that text and of each tensor's name, type, shape and bytes. So a file that was changed
//! anywhere is an error, or is read as if it had not been.

use std::borrow::Cow;
use std::collections::HashMap;
use std::fmt::Write;

use anyhow::{Context, Result, ensure};
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use sha2::{Digest, Sha256};

use super::FORMAT;

const TEXT: &str = "checkpoint";
const DIGEST: &str = "digest";

/// A tensor of the file.
#[derive(Clone)]
pub struct Part<'a> {
    pub name: Cow<'a, str>,
    pub dtype: Dtype,
    pub shape: Vec<usize>,
    pub bytes: &'a [u8],
}

impl<'a> Part<'a> {
    /// Makes a tensor of one dimension.
    pub fn flat(name: impl Into<Cow<'a, str>>, dtype: Dtype, bytes: &'a [u8]) -> Part<'a> {
        Part { name: name.into(), dtype, shape: vec![bytes.len() / (dtype.bitsize() / 8)], bytes }
    }

    fn view(&self) -> Result<TensorView<'a>> {
        Ok(TensorView::new(self.dtype, self.shape.clone(), self.bytes)?)
    }
}

/// Tensors by name, and the metadata, as safetensors takes them.
pub(crate) type Sealed<'a> = (Vec<(String, TensorView<'a>)>, HashMap<String, String>);

/// Adds the digest to the tensors and the text of a checkpoint.
pub fn seal<'a>(text: String, parts: &[Part<'a>]) -> Result<Sealed<'a>> {
    let digest = digest(&text, parts);
    let views = parts.iter().map(|part| Ok((part.name.to_string(), part.view()?))).collect::<Result<_>>()?;
    Ok((views, HashMap::from([(TEXT.to_owned(), text), (DIGEST.to_owned(), digest)])))
}

/// Reads the text of a checkpoint and the tensors of [`seal`], in the order of their names.
pub(crate) fn unseal(bytes: &[u8]) -> Result<(serde_json::Value, Vec<Part<'_>>)> {
    let file = SafeTensors::deserialize(bytes).context("it is cut short, or not a safetensors file")?;
    let (_, header) = SafeTensors::read_metadata(bytes)?;
    let metadata = header.metadata().as_ref().context("it is not a checkpoint")?;
    let text = metadata.get(TEXT).context("it is not a checkpoint")?;
    let about: serde_json::Value = serde_json::from_str(text).context("its metadata is damaged")?;
    ensure!(about["format"] == FORMAT, "it is not a checkpoint of this version of dials-traffic");
    let mut parts: Vec<Part<'_>> = file
        .iter()
        .map(|(name, tensor)| Part {
            name: name.to_owned().into(),
            dtype: tensor.dtype(),
            shape: tensor.shape().to_vec(),
            bytes: tensor.data(),
        })
        .collect();
    parts.sort_by(|a, b| a.name.cmp(&b.name));
    let sealed = metadata.get(DIGEST).context("it has no digest")?;
    ensure!(digest(text, &parts) == *sealed, "its digest is wrong: it is damaged");
    ensure!(metadata.len() == 2, "it has metadata that no checkpoint has");
    Ok((about, parts))
}

/// Every field is preceded by its length, so that no two checkpoints give the same bytes to the digest.
fn digest(text: &str, parts: &[Part<'_>]) -> String {
    let mut hasher = Sha256::new();
    let mut field = |bytes: &[u8]| {
        hasher.update((bytes.len() as u64).to_le_bytes());
        hasher.update(bytes);
    };
    field(text.as_bytes());
    for Part { name, dtype, shape, bytes } in parts {
        field(name.as_bytes());
        field(format!("{dtype:?} {shape:?}").as_bytes());
        field(bytes);
    }
    hasher.finalize().iter().fold("sha256:".to_owned(), |mut text, byte| {
        write!(text, "{byte:02x}").expect("a String takes everything");
        text
    })
}
