//! What stands twice in a list.

/// Returns the first item that equals an earlier one; `None` if all differ.
pub fn repeated<T: PartialEq>(items: &[T]) -> Option<&T> {
    (0..items.len()).find(|&place| items[..place].contains(&items[place])).map(|place| &items[place])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_one_that_came_before_is_found() {
        assert_eq!(repeated(&[1, 2, 3, 2, 1]), Some(&2));
        assert_eq!(repeated(&[1, 2, 3]), None);
    }
}
