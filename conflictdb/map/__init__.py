"""Serve the page of `conflictdb map`: scenes on a map with time, from their database, or one in a file.

app      ASGI application (starlette) behind the page
guard    access control: this machine, or holders of a token; never other sites
views    the scenes that pages show
editing  stores a plan that a page moved
live     sends the database's notifications of changes to the page
html     the same page in one file, without a database
content  packs a scene for the page
page/    the page: HTML, CSS and ES modules, served unchanged
vendor/  third-party files with their licences; vendor.json names their sources
"""
