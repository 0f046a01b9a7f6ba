//! SH functions with shared ownership: copied only by whoever changes them.

use std::ops::{Deref, DerefMut};
use std::sync::Arc;

/// SH functions of colour, one after the other. A clone is the same memory until either is changed: an asset's are by far the most that is
/// known of it, and its loader, its transfer and its export all have them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SharedSh(Arc<Vec<[f32; 3]>>);

impl Deref for SharedSh {
    type Target = Vec<[f32; 3]>;

    fn deref(&self) -> &Self::Target {
        &self.0
    }
}

impl DerefMut for SharedSh {
    fn deref_mut(&mut self) -> &mut Self::Target {
        Arc::make_mut(&mut self.0)
    }
}

impl AsRef<[[f32; 3]]> for SharedSh {
    fn as_ref(&self) -> &[[f32; 3]] {
        &self.0
    }
}

impl From<Vec<[f32; 3]>> for SharedSh {
    fn from(functions: Vec<[f32; 3]>) -> Self {
        Self(functions.into())
    }
}

impl FromIterator<[f32; 3]> for SharedSh {
    fn from_iter<I: IntoIterator<Item = [f32; 3]>>(functions: I) -> Self {
        Vec::from_iter(functions).into()
    }
}

impl<'a> IntoIterator for &'a SharedSh {
    type Item = &'a [f32; 3];
    type IntoIter = std::slice::Iter<'a, [f32; 3]>;

    fn into_iter(self) -> Self::IntoIter {
        self.0.iter()
    }
}

impl<'a> IntoIterator for &'a mut SharedSh {
    type Item = &'a mut [f32; 3];
    type IntoIter = std::slice::IterMut<'a, [f32; 3]>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter_mut()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clone_is_the_same_memory_until_one_is_changed() {
        let first: SharedSh = vec![[1.0; 3], [2.0; 3]].into();
        let mut second = first.clone();
        assert_eq!(first.as_ptr(), second.as_ptr());
        second[0] = [3.0; 3];
        assert_eq!(
            (first[0], second[0], second[1]),
            ([1.0; 3], [3.0; 3], [2.0; 3])
        );
    }
}
