//! The keys of a table that serde reads.

use serde::de::value::{Error as NoValue, StrDeserializer};
use serde::de::{DeserializeOwned, DeserializeSeed, Deserializer, Error, IntoDeserializer, MapAccess, Visitor};
use serde::forward_to_deserialize_any;

/// Returns the keys of a struct in their order, or of a table within it: the fields that its reader asks for. `path`: the
/// keys that lead to the table.
pub fn keys_of<T: DeserializeOwned>(path: &[&'static str]) -> &'static [&'static str] {
    let mut keys: &[&str] = &[];
    // The reader asks for its fields and gets none, so it fails.
    let _ = T::deserialize(Asked { path, keys: &mut keys });
    keys
}

/// A value that is nothing but a question for its fields.
struct Asked<'a> {
    path: &'a [&'static str],
    keys: &'a mut &'static [&'static str],
}

impl<'de> Deserializer<'de> for Asked<'_> {
    type Error = NoValue;

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, NoValue> {
        Err(NoValue::custom("only a struct has keys"))
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, NoValue> {
        if self.path.is_empty() {
            *self.keys = fields;
            return self.deserialize_any(visitor);
        }
        visitor.visit_map(self)
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 u8 u16 u32 u64 f32 f64 char str string bytes byte_buf option unit unit_struct newtype_struct
        seq tuple tuple_struct map enum identifier ignored_any
    }
}

/// A table with one key: the next one of the path.
impl<'de> MapAccess<'de> for Asked<'_> {
    type Error = NoValue;

    fn next_key_seed<K: DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, NoValue> {
        let name: StrDeserializer<NoValue> = self.path[0].into_deserializer();
        seed.deserialize(name).map(Some)
    }

    fn next_value_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<T::Value, NoValue> {
        seed.deserialize(Asked { path: &self.path[1..], keys: self.keys })
    }
}
