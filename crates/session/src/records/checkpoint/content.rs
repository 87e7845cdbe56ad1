//! The bytes of a checkpoint: tensors, a text about them, and one digest of both.
//!
//! The metadata of the safetensors file has two keys, and its values are text. `checkpoint` is a JSON object.
//! `digest` is the SHA-256 of that text and of each tensor's name, type, shape and bytes. So a file that was changed
//! anywhere is an error, or is read as if it had not been.

use std::collections::{BTreeMap, HashMap};
use std::fmt::Write;

use anyhow::{Context, Result, ensure};
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use sha2::{Digest, Sha256};

use super::FORMAT;

const TEXT: &str = "checkpoint";
const DIGEST: &str = "digest";

pub type Tensors<'a> = BTreeMap<String, TensorView<'a>>;

/// Makes a tensor of one dimension.
pub fn flat(dtype: Dtype, bytes: &[u8]) -> Result<TensorView<'_>> {
    Ok(TensorView::new(dtype, vec![bytes.len() / (dtype.bitsize() / 8)], bytes)?)
}

/// Returns the metadata of a checkpoint with this text and these tensors.
pub fn seal(text: String, tensors: &Tensors<'_>) -> HashMap<String, String> {
    let digest = digest(&text, tensors);
    HashMap::from([(TEXT.to_owned(), text), (DIGEST.to_owned(), digest)])
}

/// Reads the text and the tensors of a checkpoint with the metadata of [`seal`].
pub(crate) fn unseal(bytes: &[u8]) -> Result<(serde_json::Value, Tensors<'_>)> {
    let file = SafeTensors::deserialize(bytes).context("it is cut short, or not a safetensors file")?;
    let (_, header) = SafeTensors::read_metadata(bytes)?;
    let metadata = header.metadata().as_ref().context("it is not a checkpoint")?;
    let text = metadata.get(TEXT).context("it is not a checkpoint")?;
    let about: serde_json::Value = serde_json::from_str(text).context("its metadata is damaged")?;
    ensure!(about["format"] == FORMAT, "it is not a checkpoint of this version of dials-traffic");
    let tensors = file.tensors().into_iter().collect();
    let sealed = metadata.get(DIGEST).context("it has no digest")?;
    ensure!(digest(text, &tensors) == *sealed, "its digest is wrong: it is damaged");
    ensure!(metadata.len() == 2, "it has metadata that no checkpoint has");
    Ok((about, tensors))
}

/// Every field is preceded by its length, so that no two checkpoints give the same bytes to the digest.
fn digest(text: &str, tensors: &Tensors<'_>) -> String {
    let mut hasher = Sha256::new();
    let mut field = |bytes: &[u8]| {
        hasher.update((bytes.len() as u64).to_le_bytes());
        hasher.update(bytes);
    };
    field(text.as_bytes());
    for (name, tensor) in tensors {
        field(name.as_bytes());
        field(format!("{:?} {:?}", tensor.dtype(), tensor.shape()).as_bytes());
        field(tensor.data());
    }
    hasher.finalize().iter().fold("sha256:".to_owned(), |mut text, byte| {
        write!(text, "{byte:02x}").expect("a String takes everything");
        text
    })
}
