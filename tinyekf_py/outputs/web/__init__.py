"""The live page, its API, metrics, and Signal K over WebSocket, served by aiohttp (the extra [web]).

    guard ──> access ──> routes ──> state, history, metrics, requests to the program
    (connections)  (who may)   └──> streams: each frame encoded once, for all who watch

docs/web.md says what is served, docs/security.md to whom.
"""
