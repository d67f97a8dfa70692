// A table of text as spreadsheets save it (RFC 4180): commas, semicolons or tabs, quotes, any end of line.

/** The rows of a table, each a list of texts; empty lines are left out. */
export function rowsOf(text) {
  const plain = text.replace(/^\uFEFF/, '');
  const separator = separatorOf(plain);
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
    else if (c !== '\r') cell += c;
  }
  endRow();
  return rows;
}

/** Whichever stands most often in the first line, outside quotes. */
function separatorOf(text) {
  const first = text.split('\n', 1)[0].replace(/"[^"]*"/g, '');
  const count = separator => first.split(separator).length;
  return [',', ';', '\t'].reduce((best, one) => (count(one) > count(best) ? one : best));
}
