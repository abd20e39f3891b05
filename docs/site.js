// What scrolls sideways can be reached by keys, and the search has a name.
function reachable() {
  for (const part of document.querySelectorAll('.md-typeset__scrollwrap, pre > code, .output, math[display="block"]'))
    if (part.scrollWidth > part.clientWidth) part.tabIndex = 0
  document.querySelector(".md-search")?.setAttribute("aria-label", "Search")
}

window.addEventListener("load", () => setTimeout(reachable))
window.addEventListener("resize", reachable)
