#!/bin/sh
# Make a certificate authority and one certificate each for the daemon, a pilot and a watcher.
#   sh configs/zenoh/certificates.sh FOLDER [HOST...]
# HOST are names or addresses clients use for the daemon; localhost and 127.0.0.1 are always among them.
# Keep ca.key and the folder away from the network; give each machine only its own pair and ca.pem.
set -eu
folder=${1:?which folder?}
shift
names="DNS:localhost,IP:127.0.0.1"
for host in "$@"; do
    case $host in
        *[!0-9.]*) names="$names,DNS:$host" ;;
        *) names="$names,IP:$host" ;;
    esac
done
mkdir -p "$folder"
cd "$folder"
umask 077
openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 3650 -subj "/CN=mkdaemon authority" \
    -addext "basicConstraints=critical,CA:TRUE,pathlen:0" -addext "keyUsage=critical,keyCertSign,cRLSign" \
    -keyout ca.key -out ca.pem 2>/dev/null
for who in daemon pilot watcher; do
    openssl req -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -subj "/CN=$who" \
        -keyout "$who.key" -out "$who.csr" 2>/dev/null
    # The daemon also connects, to a router for example; a client's certificate is good for no server and no host.
    {
        printf 'basicConstraints=critical,CA:FALSE\nkeyUsage=critical,digitalSignature\n'
        if [ "$who" = daemon ]; then
            printf 'extendedKeyUsage=serverAuth,clientAuth\nsubjectAltName=%s\n' "$names"
        else
            printf 'extendedKeyUsage=clientAuth\n'
        fi
    } > "$who.ext"
    openssl x509 -req -in "$who.csr" -CA ca.pem -CAkey ca.key -CAcreateserial -days 825 -extfile "$who.ext" \
        -out "$who.pem" 2>/dev/null
    rm "$who.csr" "$who.ext"
done
ls
