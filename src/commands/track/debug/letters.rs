//! Letters for legends, three columns by five rows, one octal digit per row. So no font has to be found or shipped.

/// Columns and rows of a letter, without the space between letters.
pub(super) const SIZE: (usize, usize) = (3, 5);

/// True if this pixel of a letter is drawn. Small letters are drawn as capitals, unknown characters as spaces.
pub(super) fn is_ink(letter: char, column: usize, row: usize) -> bool {
    let rows = rows(letter.to_ascii_uppercase());
    let digit = rows >> (3 * (SIZE.1 - 1 - row)) & 0o7;
    digit >> (SIZE.0 - 1 - column) & 1 == 1
}

fn rows(letter: char) -> u32 {
    const CAPITALS: [u32; 26] = [
        0o25755, 0o65656, 0o34443, 0o65556, 0o74647, 0o74644, 0o34553, 0o55755, 0o72227, 0o11152, 0o55655, 0o44447,
        0o57755, 0o65555, 0o25552, 0o65644, 0o25563, 0o65655, 0o34216, 0o72222, 0o55557, 0o55552, 0o55775, 0o55255,
        0o55222, 0o71247,
    ];
    const DIGITS: [u32; 10] =
        [0o75557, 0o26227, 0o71747, 0o71717, 0o55711, 0o74717, 0o74757, 0o71111, 0o75757, 0o75717];
    match letter {
        'A'..='Z' => CAPITALS[letter as usize - 'A' as usize],
        '0'..='9' => DIGITS[letter as usize - '0' as usize],
        '.' => 0o00002,
        '\'' => 0o22000,
        ',' => 0o00024,
        ':' => 0o02020,
        ';' => 0o02024,
        '-' => 0o00700,
        '_' => 0o00007,
        '/' => 0o11244,
        '%' => 0o51245,
        '(' => 0o12221,
        ')' => 0o42224,
        '=' => 0o07070,
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_read_as_drawn() {
        let drawn = |letter| {
            let row = |y| (0..SIZE.0).map(|x| if is_ink(letter, x, y) { '#' } else { '.' }).collect::<String>();
            (0..SIZE.1).map(row).collect::<Vec<_>>().join("/")
        };
        assert_eq!(drawn('h'), "#.#/#.#/###/#.#/#.#");
        assert_eq!(drawn('7'), "###/..#/..#/..#/..#");
        assert_eq!(drawn('é'), ".../.../.../.../...");
    }
}
