"""The page of `conflictdb map`: a scene on a map with time, from its database or in one file.

app      what the page asks for: an ASGI application (starlette)
guard    who may ask: this machine, or whoever has a token; never another site
live     tells the page of changes as the database tells of them
html     the same page in one file, without a database
content  a scene as the page reads it
land     coastlines
page/    the page: HTML, CSS and ES modules as they are
vendor/  what comes from others, with its licences; vendor.json says from where
"""
