/** Words for the page: filled in, and escaped before they become HTML. */

export function fill(text: string, values: { [name: string]: string | number }): string {
  return text.replace(/\{(\w+)\}/g, (whole, name: string) =>
    Object.prototype.hasOwnProperty.call(values, name) ? String(values[name]) : whole,
  );
}

export function escaped(text: string): string {
  const holder = document.createElement("span");
  holder.textContent = text;
  return holder.innerHTML;
}

/** Paragraphs of a text, parted by blank lines, as HTML. */
export function paragraphs(text: string): string {
  return text
    .trim()
    .split(/\n\s*\n/)
    .map((part) => `<p>${escaped(part.trim())}</p>`)
    .join("");
}

/** A page: its title and text, as HTML. */
export function pageOf(title: string, body: string): string {
  return `<h1>${escaped(title)}</h1>${paragraphs(body)}`;
}
