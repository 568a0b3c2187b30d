//! The settings of a refinement as text.

use super::error::SolveError;
use super::steer::Steering;
use crate::files::overlay;
use crate::plan::Storage;

impl Steering {
    /// The defaults with what a TOML text says by the names of the fields.
    ///
    /// # Errors
    /// [`SolveError::Text`] with the key that is not known or has no such value; [`SolveError::Setting`].
    pub fn from_toml(text: &str) -> Result<Self, SolveError> {
        // Its storage is there, so that the key is.
        let shown = Self { storage: Some(Storage::F32), ..Self::default() };
        let (mut read, given) = overlay(&shown, &[], text).map_err(SolveError::Text)?;
        read.storage = read.storage.filter(|_| given.contains_key("storage"));
        read.check()?;
        Ok(read)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_said_lies_over_what_is_by_default() {
        assert_eq!(Steering::from_toml("").unwrap(), Steering::default());
        let said = Steering::from_toml("pupils = 3\nstorage = \"fp16\"").unwrap();
        assert_eq!(said, Steering { pupils: 3, storage: Some(Storage::F16), ..Steering::default() });
        for (text, says) in [("pupil = 3", "pupil: no such setting"), ("pupils = 0", "the number of pupils")] {
            assert!(Steering::from_toml(text).unwrap_err().to_string().contains(says), "{text}");
        }
    }
}
