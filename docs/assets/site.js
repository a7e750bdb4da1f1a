// What the theme leaves out for readers without a mouse or a screen.
document.querySelector(".md-search")?.setAttribute("aria-label", "Search");
const focusable = () => {
  for (const box of document.querySelectorAll(".md-typeset__scrollwrap, .md-typeset pre > code"))
    box.tabIndex = 0;
};
addEventListener("load", focusable);
