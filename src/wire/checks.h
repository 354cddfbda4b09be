#pragma once
// What the fields of control messages may be. Private to the codec. Null: fine; else why not.
#include "wire/messages.h"

namespace cloudrenderer::wire {

const char* check(const Hello& m);
const char* check(const Welcome& m);
const char* check(const PeerHello& m);
const char* check(const HostList& m);
const char* check(const SceneHostMap& m);
const char* check(const JobStart& m);
const char* check(const LoadParts& m);
const char* check(const UnloadParts& m);
const char* check(const LoadReport& m);
const char* check(const BlobRequest& m);
const char* check(const BlobChunk& m);
const char* check(const Status& m);
const char* check(const PoolWelcome& m);
const char* check(const PoolOrders& m);
const char* check(const PoolStatus& m);
// Nothing in them can do harm.
inline const char* check(const Challenge&) { return nullptr; }
inline const char* check(const Proof&) { return nullptr; }
inline const char* check(const Refused&) { return nullptr; }
inline const char* check(const JobEnd&) { return nullptr; }
inline const char* check(const CancelJob&) { return nullptr; }
inline const char* check(const CancelTask&) { return nullptr; }
inline const char* check(const Leave&) { return nullptr; }
inline const char* check(const Error&) { return nullptr; }

}  // namespace cloudrenderer::wire
