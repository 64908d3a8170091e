// What a search puts first: pages and names whose titles have the most of its words, with
// pages for users before the reference; the changelog last.
const asked = (new URLSearchParams(location.search).get("q") || "").toLowerCase().split(/\s+/);
var Scorer = {
  score: ([docname, title, anchor, descr, score]) => {
    if (/changelog/.test(docname)) return score - 100;
    const named = asked.filter((word) => word && title.toLowerCase().includes(word)).length;
    return score + 10 * named + (/^(start|tutorials|how_to)\//.test(docname) ? 5 : 0);
  },
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 30,
  partialTitle: 15,
  term: 5,
  partialTerm: 2,
};
