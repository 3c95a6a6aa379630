/** Words are filled in and escaped, whatever they are. */
import * as fc from "fast-check";
import { describe, expect, it } from "vitest";

import { escaped, fill, pageOf, paragraphs } from "../src/words";

function textOf(html: string): string {
  const holder = document.createElement("div");
  holder.innerHTML = html;
  return holder.textContent;
}

describe("a text", () => {
  it("is filled in where it names a value, as often as it does", () => {
    expect(fill("{a} of {b}, {a}", { a: 1, b: "two" })).toBe("1 of two, 1");
  });

  it("keeps what names no value, even if every object has something of that name", () => {
    expect(fill("{c} {toString} {constructor} {}", { a: 1 })).toBe("{c} {toString} {constructor} {}");
  });

  it("takes a value as it stands", () => {
    fc.assert(
      fc.property(fc.string(), (value) => {
        expect(fill("<{a}>", { a: value })).toBe(`<${value}>`);
      }),
    );
  });

  it("is shown as it stands, and makes no element", () => {
    fc.assert(
      fc.property(fc.string(), (text) => {
        const holder = document.createElement("div");
        holder.innerHTML = escaped(text);
        expect(holder.childElementCount).toBe(0);
        expect(holder.textContent).toBe(text);
      }),
    );
    expect(escaped("<b>&amp;</b>")).toBe("&lt;b&gt;&amp;amp;&lt;/b&gt;");
  });

  it("has paragraphs where it has blank lines", () => {
    expect(paragraphs("one\nline\n\n two \n \n\nthree\n")).toBe("<p>one\nline</p><p>two</p><p>three</p>");
    expect(textOf(pageOf("A <title>", "A & B"))).toBe("A <title>A & B");
  });
});
