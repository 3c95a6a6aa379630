/** The transport that the page was made for: `experiment/export.py` writes it into the page. */
import { JatosTransport } from "./jatos";
import { ServerTransport } from "./server";
import { StaticTransport } from "./static";
import type { Transport } from "./transport";

export function makeTransport(link: { [name: string]: string }): Transport {
  const wanted = document.querySelector<HTMLMetaElement>("meta[name=pourcast-transport]")?.content;
  if (wanted === "jatos") return new JatosTransport(link);
  return wanted === "static" ? new StaticTransport(link) : new ServerTransport(link);
}
