//! Places in a text: byte offsets → lines and columns, as messages state them.

/// Line and column, both from 1, of byte `at`; columns count characters.
pub fn line_and_column(text: &str, at: usize) -> (usize, usize) {
    let mut at = at.min(text.len());
    while !text.is_char_boundary(at) {
        at -= 1;
    }
    let bytes = text.as_bytes();
    let ends_line = |i: usize| bytes[i] == b'\n' || (bytes[i] == b'\r' && bytes.get(i + 1) != Some(&b'\n'));
    let line = (0..at).filter(|i| ends_line(*i)).count() + 1;
    let start = (0..at).rev().find(|i| ends_line(*i)).map_or(0, |i| i + 1);
    (line, text[start..at].chars().count() + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_count_characters_and_lines_end_three_ways() {
        let text = "a\r\nb\rç d\ne";
        assert_eq!(line_and_column(text, text.find('d').unwrap()), (3, 3));
        assert_eq!(line_and_column(text, text.len()), (4, 2));
        assert_eq!(line_and_column(text, 99), (4, 2));
    }
}
