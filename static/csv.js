// A table of text as spreadsheets save it (RFC 4180): commas, semicolons or tabs, quotes, any end of line.

/** What a file says: as UTF-8, or as spreadsheets wrote it before they did that. */
export async function textOf(file) {
  const bytes = await file.arrayBuffer();
  const [first, second] = new Uint8Array(bytes);
  if (first === 0xff && second === 0xfe) return new TextDecoder('utf-16le').decode(bytes);
  try {
    return new TextDecoder('utf-8', { fatal: true }).decode(bytes);
  } catch {
    return new TextDecoder('windows-1252').decode(bytes);
  }
}

/** The rows of a table, each a list of texts; empty lines are left out. */
export function rowsOf(text) {
  const { plain, separator } = begun(text.replace(/^\uFEFF/, '').replace(/\r\n?/g, '\n'));
  const rows = [];
  let [row, cell, isQuoted] = [[], '', false];
  const endCell = () => (row.push(cell.trim()), (cell = ''));
  const endRow = () => {
    endCell();
    if (row.some(Boolean)) rows.push(row);
    row = [];
  };
  for (let i = 0; i < plain.length; i += 1) {
    const c = plain[i];
    if (isQuoted) {
      if (c !== '"') cell += c;
      else if (plain[i + 1] === '"') [cell, i] = [`${cell}"`, i + 1];
      else isQuoted = false;
    } else if (c === '"' && cell.trim() === '') [isQuoted, cell] = [true, ''];
    else if (c === separator) endCell();
    else if (c === '\n') endRow();
    else cell += c;
  }
  endRow();
  return rows;
}

/** The text from its first row on; before it a spreadsheet may have told its separator. */
function begun(text) {
  const [whole, told] = /^\s*sep=(.)\n/i.exec(text) ?? [''];
  const plain = text.slice(whole.length).replace(/^\s*\n/, '');
  return { plain, separator: told ?? separatorOf(plain) };
}

/** Whichever stands most often in the first line, outside quotes. */
function separatorOf(text) {
  const first = text.split('\n', 1)[0].replace(/"[^"]*"/g, '');
  const count = separator => first.split(separator).length;
  return [',', ';', '\t'].reduce((best, one) => (count(one) > count(best) ? one : best));
}
