/** The transport that the page was made for. */
import { ServerTransport, type Transport } from "./transport";

export function makeTransport(link: { [name: string]: string }): Transport {
  return new ServerTransport(link);
}
